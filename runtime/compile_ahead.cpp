#include "runtime/compile_ahead.hpp"

#include <array>
#include <cstdint>
#include <exception>
#include <string>
#include <system_error>
#include <utility>

#include "runtime/device.hpp"
#include "runtime/kernel.hpp"
#include "runtime/program.hpp"

namespace ecir {
namespace {

struct Source {
    std::string shader;
    std::vector<uint32_t> constants;
    uint32_t bindings;
    uint32_t push_bytes;
};

void dispatch_nothing(Device& device, const Source& source,
                      const std::shared_ptr<const Buffer>& any) {
    Program program(device);
    Dispatch dispatch;
    dispatch.kernel =
        &device.kernel(source.shader, source.constants, source.bindings, source.push_bytes);
    dispatch.arguments.assign(source.bindings, constant(any));
    dispatch.push.resize(source.push_bytes);
    dispatch.groups = {0, 0, 0};
    dispatch.label = source.shader;
    program.add(std::move(dispatch));
    program.finish();
    program.run();
}

} // namespace

CompileAhead::CompileAhead(const Device& device, const std::vector<const Kernel*>& kernels) {
    std::vector<Source> sources;
    for (const Kernel* kernel : kernels) {
        const Reflection& found = kernel->reflection();
        sources.push_back({kernel->name(), kernel->constants(),
                           static_cast<uint32_t>(found.bindings.size()), found.push_bytes});
    }
    const auto compile = [this, &device, sources = std::move(sources)]() mutable {
        try {
            const auto twin = device.twin();
            const auto any = upload<float>(*twin, std::array{0.0F});
            for (; !sources.empty() && !ends_; sources.pop_back()) {
                dispatch_nothing(*twin, sources.back(), any);
            }
        } catch (const std::exception&) {
            // The device itself compiles what is left, and says what is wrong.
        }
    };
    try {
        thread_ = std::thread(compile);
    } catch (const std::system_error&) {
        // No thread is to be had: the device compiles alone.
    }
}

CompileAhead::~CompileAhead() {
    if (thread_.joinable()) {
        thread_.join();
    }
}

} // namespace ecir
