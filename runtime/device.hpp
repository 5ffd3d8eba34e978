#pragma once
#include <array>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/buffer.hpp"
#include "runtime/instance.hpp"
#include "runtime/matrices.hpp"
#include "runtime/vk.hpp"

namespace ecir {

class Kernel;
class KernelCache;

/// What convolutions multiply in, where their kernels for a device know both (layers/conv.hpp).
enum class Precision { float32, float16 };

/// What a device is and offers; everything here was asked for, nothing assumed.
struct DeviceInfo {
    uint32_t index = 0; ///< position in Device::list(), the number that -g takes
    std::string name;
    std::string type;   ///< "discrete GPU", "integrated GPU", "virtual GPU", "CPU" or "other"
    std::string driver; ///< driver name and version
    bool is_cpu = false;
    bool is_default = false;
    std::string lacks; ///< what it has too little of for this library; empty: nothing
    uint32_t subgroup_size = 0;
    bool buffer_address = false; ///< bufferDeviceAddress and shaderInt64
    bool storage16 = false;      ///< 16-bit values in storage buffers
    bool float16 = false;        ///< float16 arithmetic
    Matrices matrices;           ///< cooperative ones
    uint64_t timestamp_mask = 0; ///< the bits of a timestamp that count; 0: it has none
    double timestamp_ns = 1;     ///< nanoseconds a timestamp tick
    uint64_t max_storage_range = 0;
    uint64_t max_uniform_range = 0;
    uint32_t max_storage_buffers = 0; ///< that a kernel binds
    uint32_t max_invocations = 0;     ///< of a workgroup
    uint32_t max_push_bytes = 0;
    uint32_t max_shared_bytes = 0;        ///< shared memory of a workgroup
    std::array<uint32_t, 3> max_groups{}; ///< workgroups of a dispatch along x, y and z
    uint64_t max_allocation = 0;
    uint64_t heap_bytes = 0; ///< of the heap that device buffers come from
    uint64_t uniform_alignment = 1;
    uint64_t storage_alignment = 1;
};

/// 16-bit storage and arithmetic, which float16 kernels take.
inline bool has_float16(const DeviceInfo& info) {
    return info.float16 && info.storage16;
}

/// One logical device with its compute queues.
class Device {
public:
    /// All devices, the default one marked: a discrete GPU, else an integrated or virtual one, else
    /// a CPU driver; one that lacks something only where all do. Throws Error(device) saying what
    /// to install when there is none.
    static std::vector<DeviceInfo> list();

    /// Opens the default device, or the one whose index or part of whose name `selector` is
    /// (upper and lower case alike). Throws Error(device) listing the devices when none matches.
    /// Networks made for the device multiply in `precision`; check_precision() of layers/conv.hpp
    /// says whether it can.
    static std::shared_ptr<Device> open(const std::string& selector = {},
                                        Precision precision = Precision::float32);

    /// Another logical device on the same physical one.
    [[nodiscard]] std::shared_ptr<Device> twin() const;

    ~Device();
    Device(const Device&) = delete;
    Device& operator=(const Device&) = delete;

    [[nodiscard]] const DeviceInfo& info() const { return info_; }
    [[nodiscard]] Precision precision() const { return precision_; }
    [[nodiscard]] VkDevice handle() const { return device_; }
    /// Queues that work can go to at once: 2 on a GPU whose compute family has them, else 1.
    /// ECIR_QUEUES, 1 or 2, says otherwise; a device with fewer takes the work in turn then.
    [[nodiscard]] uint32_t queues() const { return static_cast<uint32_t>(queues_.size()); }
    [[nodiscard]] uint32_t queue_family() const { return queue_family_; }

    /// The kernel `shader` (a file name in shaders/ without .comp) with its specialization
    /// constants 0, 1, ... set, made once and kept. Its bindings and push-constant block are
    /// reflected from the SPIR-V; throws Error(device) when they do not match what the caller
    /// expects.
    const Kernel& kernel(std::string_view shader, std::span<const uint32_t> constants,
                         uint32_t bindings, uint32_t push_bytes);

    /// `tell` is called once, when so many kernels have been asked for that no earlier run made on
    /// this device (by the cache folder's list of them) that compiling takes seconds on a CPU
    /// driver. Never where there is no cache folder.
    void on_compiling(std::function<void()> tell);

    /// Index of a memory type with all `wanted` flags among `types`, preferring `liked` ones too.
    [[nodiscard]] uint32_t memory_type(uint32_t types, VkMemoryPropertyFlags wanted,
                                       VkMemoryPropertyFlags liked) const;

    /// Runs command buffers in order, one submission each, and waits for the last. Where this
    /// throws none of them is under way.
    void submit(std::span<const VkCommandBuffer> commands, uint32_t queue = 0);
    /// The same without waiting: `fence`, which is not signalled yet, will be after the last.
    void start(std::span<const VkCommandBuffer> commands, VkFence fence, uint32_t queue = 0);
    /// Waits for what start() gave this fence, which can then be used again.
    void wait(VkFence fence);
    [[nodiscard]] Handle<VkFence> make_fence() const;

private:
    Device(std::shared_ptr<Instance> instance, VkPhysicalDevice physical, DeviceInfo info,
           Precision precision);

    std::shared_ptr<Instance> instance_;
    VkPhysicalDevice physical_;
    DeviceInfo info_;
    Precision precision_;
    VkPhysicalDeviceMemoryProperties memory_{};
    VkDevice device_ = VK_NULL_HANDLE;
    std::vector<VkQueue> queues_;
    uint32_t queue_family_ = 0;
    Handle<VkFence> fence_;
    std::unique_ptr<KernelCache> kernels_;
};

} // namespace ecir
