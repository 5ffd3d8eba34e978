#pragma once
#include <memory>
#include <string>
#include <vector>

#include "runtime/vk.hpp"

namespace ecir {

/// The Vulkan instance, with the Khronos validation layer when ECIR_VALIDATION=1, which then also
/// looks for missing barriers (of what kernels reach by address it sees nothing).
class Instance {
public:
    Instance();
    ~Instance();
    Instance(const Instance&) = delete;
    Instance& operator=(const Instance&) = delete;

    [[nodiscard]] VkInstance handle() const { return instance_; }
    /// Empty when the loader finds no driver.
    [[nodiscard]] std::vector<VkPhysicalDevice> physical_devices() const;

    /// One instance for the process as long as somebody holds it.
    static std::shared_ptr<Instance> shared();

private:
    VkInstance instance_ = VK_NULL_HANDLE;
    VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
};

/// Warnings and errors that the validation layer has reported in this process so far.
std::vector<std::string> validation_messages();

/// Throws Error(device) with the first message if the validation layer reported any.
void check_validation();

} // namespace ecir
