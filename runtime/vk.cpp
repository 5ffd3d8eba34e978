#include "runtime/vk.hpp"

#include <string>

#include "runtime/error.hpp"

namespace ecir {
namespace {

const char* result_name(VkResult result) {
    switch (result) {
    case VK_ERROR_OUT_OF_HOST_MEMORY:
        return "VK_ERROR_OUT_OF_HOST_MEMORY";
    case VK_ERROR_OUT_OF_DEVICE_MEMORY:
        return "VK_ERROR_OUT_OF_DEVICE_MEMORY";
    case VK_ERROR_INITIALIZATION_FAILED:
        return "VK_ERROR_INITIALIZATION_FAILED";
    case VK_ERROR_DEVICE_LOST:
        return "VK_ERROR_DEVICE_LOST";
    case VK_ERROR_MEMORY_MAP_FAILED:
        return "VK_ERROR_MEMORY_MAP_FAILED";
    case VK_ERROR_LAYER_NOT_PRESENT:
        return "VK_ERROR_LAYER_NOT_PRESENT";
    case VK_ERROR_EXTENSION_NOT_PRESENT:
        return "VK_ERROR_EXTENSION_NOT_PRESENT";
    case VK_ERROR_FEATURE_NOT_PRESENT:
        return "VK_ERROR_FEATURE_NOT_PRESENT";
    case VK_ERROR_INCOMPATIBLE_DRIVER:
        return "VK_ERROR_INCOMPATIBLE_DRIVER";
    case VK_ERROR_OUT_OF_POOL_MEMORY:
        return "VK_ERROR_OUT_OF_POOL_MEMORY";
    case VK_TIMEOUT:
        return "VK_TIMEOUT";
    default:
        return "unexpected result";
    }
}

} // namespace

void vk_check(VkResult result, const char* call) {
    if (result == VK_SUCCESS || result == VK_INCOMPLETE) {
        return;
    }
    std::string message = std::string(call) + " failed: " + result_name(result) + " (" +
                          std::to_string(static_cast<int>(result)) + ")";
    if (result == VK_ERROR_OUT_OF_HOST_MEMORY || result == VK_ERROR_OUT_OF_DEVICE_MEMORY) {
        throw Error(ExitCode::resources, message + "; try a smaller --size or fewer --frames");
    }
    if (result == VK_ERROR_DEVICE_LOST) {
        message += "; the driver gave the device up: update it, or try another device with -g";
    }
    throw Error(ExitCode::device, message);
}

} // namespace ecir
