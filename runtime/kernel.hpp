#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/compile_queue.hpp"
#include "runtime/known_kernels.hpp"
#include "runtime/vk.hpp"

namespace ecir {

class Device;

/// What a shader's SPIR-V declares.
struct Reflection {
    struct Binding {
        uint32_t index;
        bool uniform; ///< uniform buffer (bound with a dynamic offset), else storage buffer
    };
    std::vector<Binding> bindings; ///< set 0, by index: 0, 1, 2, ...
    uint32_t push_bytes = 0;
    bool matrices = false; ///< cooperative ones, which need full subgroups
};

/// Reads bindings and push-constant size. Throws Error(device) for a shader outside the
/// conventions: descriptor set 0 only, bindings numbered without gaps, storage and uniform buffers
/// only.
Reflection reflect(std::string_view name, std::span<const uint32_t> spirv);

/// SPIR-V of a shader built into the library; throws Error(device) for an unknown name.
std::span<const uint32_t> embedded_shader(std::string_view name);
/// Whether it is built in: those in shaders/optional/ only where the GLSL compiler knew their
/// extensions.
bool is_embedded(std::string_view name);

/// A compute pipeline made from one shader and its specialization constants, compiled meanwhile on
/// another thread.
class Kernel {
public:
    Kernel(Device& device, std::string_view name, std::span<const uint32_t> constants,
           VkPipelineCache cache, CompileQueue& queue, bool fresh);

    [[nodiscard]] const std::string& name() const { return name_; }
    [[nodiscard]] const std::vector<uint32_t>& constants() const { return constants_; }
    [[nodiscard]] const Reflection& reflection() const { return reflection_; }
    /// Whether no earlier run made it on this device, and nobody compiles it ahead: a CPU driver
    /// compiles when it first runs.
    [[nodiscard]] bool fresh() const { return fresh_; }
    void compiles_ahead() const { fresh_ = false; }
    /// Waits for the driver's compiler; throws Error(device) or Error(resources) where that failed.
    [[nodiscard]] VkPipeline pipeline() const { return pipeline_.get().get(); }
    [[nodiscard]] VkPipelineLayout layout() const { return layout_.get(); }
    [[nodiscard]] VkDescriptorSetLayout set_layout() const { return set_layout_.get(); }

private:
    std::string name_;
    std::vector<uint32_t> constants_;
    mutable std::atomic<bool> fresh_;
    Reflection reflection_;
    Handle<VkDescriptorSetLayout> set_layout_;
    Handle<VkPipelineLayout> layout_;
    CompileQueue::Pipeline pipeline_;
};

/// Kernels of one device, made on first use; the driver's pipeline cache is kept on disk
/// ($XDG_CACHE_HOME/ecir or ~/.cache/ecir; ECIR_CACHE_DIR sets another folder, empty for none).
class KernelCache {
public:
    explicit KernelCache(Device& device);
    ~KernelCache();
    KernelCache(const KernelCache&) = delete;
    KernelCache& operator=(const KernelCache&) = delete;

    const Kernel& get(std::string_view name, std::span<const uint32_t> constants);

    /// See Device::on_compiling().
    void on_compiling(std::function<void()> tell) { tell_ = std::move(tell); }

private:
    Device& device_;
    std::unique_ptr<CompileQueue> queue_; ///< of the kernels; ends before the caches are written
    std::string file_;
    Handle<VkPipelineCache> cache_;
    size_t loaded_bytes_ = 0;
    KnownKernels known_;
    std::function<void()> tell_;
    std::map<std::pair<std::string, std::vector<uint32_t>>, Kernel> kernels_;
};

} // namespace ecir
