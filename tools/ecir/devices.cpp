#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "runtime/device.hpp"
#include "tools/ecir/commands.hpp"

namespace ecir::cli {
namespace {

const char* reason(const DeviceInfo& device) {
    return device.is_cpu ? "default: no GPU was found, this driver runs on the CPU"
                         : "default: the first of the fastest kind of device";
}

/// For example "16x16x16 (khr)".
std::string matrices(const DeviceInfo& device) {
    const Matrices& shape = device.matrices;
    if (shape.form == Matrices::Form::none) {
        return "none";
    }
    return std::to_string(shape.m) + "x" + std::to_string(shape.n) + "x" + std::to_string(shape.k) +
           " (" + std::string(form_name(shape.form)) + ")";
}

void run(bool as_json) {
    const auto devices = Device::list();
    if (as_json) {
        auto list = nlohmann::json::array();
        for (const DeviceInfo& device : devices) {
            list.push_back({{"index", device.index},
                            {"name", device.name},
                            {"type", device.type},
                            {"driver", device.driver},
                            {"default", device.is_default},
                            {"subgroup_size", device.subgroup_size},
                            {"buffer_address", device.buffer_address},
                            {"storage16", device.storage16},
                            {"float16", device.float16},
                            {"matrices", matrices(device)},
                            {"timestamps", device.timestamp_mask != 0},
                            {"lacks", device.lacks},
                            {"memory_bytes", device.heap_bytes},
                            {"max_storage_range", device.max_storage_range}});
        }
        std::printf("%s\n", list.dump(2).c_str());
        return;
    }
    for (const DeviceInfo& device : devices) {
        std::printf("%u  %s (%s), %s\n", device.index, device.name.c_str(), device.type.c_str(),
                    device.driver.c_str());
        std::printf("   %.1f GiB, subgroups of %u, 16-bit storage %s, float16 %s, cooperative "
                    "matrices %s, timestamps %s\n",
                    static_cast<double>(device.heap_bytes) / (1U << 30), device.subgroup_size,
                    device.storage16 ? "yes" : "no", device.float16 ? "yes" : "no",
                    matrices(device).c_str(), device.timestamp_mask != 0 ? "yes" : "no");
        if (!device.lacks.empty()) {
            std::printf("   lacks %s\n", device.lacks.c_str());
        }
        if (device.is_default) {
            std::printf("   %s\n", reason(device));
        }
    }
}

} // namespace

void add_devices(CLI::App& app) {
    auto* command =
        app.add_subcommand("devices", "List the Vulkan devices and which one is the default");
    auto as_json = std::make_shared<bool>(false);
    command->add_flag("--json", *as_json, "Print as JSON");
    command->footer("A device's index or any part of its name is what -g takes elsewhere.\n"
                    "\n"
                    "Example:\n"
                    "  ecir devices --json");
    command->callback([as_json] { run(*as_json); });
}

} // namespace ecir::cli
