#include "runtime/instance.hpp"

#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>

#include "runtime/error.hpp"

namespace ecir {
namespace {

constexpr const char* kValidationLayer = "VK_LAYER_KHRONOS_validation";

std::mutex g_mutex;
std::vector<std::string> g_messages;

VKAPI_ATTR VkBool32 VKAPI_CALL on_message(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                          VkDebugUtilsMessageTypeFlagsEXT,
                                          const VkDebugUtilsMessengerCallbackDataEXT* data, void*) {
    const std::lock_guard lock(g_mutex);
    g_messages.emplace_back(data->pMessage);
    std::fprintf(stderr, "ecir: validation: %s\n", data->pMessage);
    return VK_FALSE;
}

VkDebugUtilsMessengerCreateInfoEXT messenger_info() {
    VkDebugUtilsMessengerCreateInfoEXT info{};
    info.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
    info.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT |
                           VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
    info.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT |
                       VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT;
    info.pfnUserCallback = on_message;
    return info;
}

bool validation_wanted() {
    const char* value = std::getenv("ECIR_VALIDATION");
    return value != nullptr && std::strcmp(value, "1") == 0;
}

bool layer_present() {
    uint32_t count = 0;
    vk_check(vkEnumerateInstanceLayerProperties(&count, nullptr),
             "vkEnumerateInstanceLayerProperties");
    std::vector<VkLayerProperties> layers(count);
    vk_check(vkEnumerateInstanceLayerProperties(&count, layers.data()),
             "vkEnumerateInstanceLayerProperties");
    for (const auto& layer : layers) {
        if (std::strcmp(layer.layerName, kValidationLayer) == 0) {
            return true;
        }
    }
    return false;
}

} // namespace

Instance::Instance() {
    const bool validation = validation_wanted();
    if (validation && !layer_present()) {
        throw Error(ExitCode::device,
                    "ECIR_VALIDATION=1 is set, but the Khronos validation layer is not installed; "
                    "on Debian: apt-get install vulkan-validationlayers");
    }
    VkApplicationInfo application{};
    application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
    application.pApplicationName = "ecir";
    application.apiVersion = VK_API_VERSION_1_2;

    constexpr std::array kExtensions{VK_EXT_DEBUG_UTILS_EXTENSION_NAME,
                                     VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME};
    const auto debug = messenger_info();
    constexpr auto kSynchronization = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT;
    VkValidationFeaturesEXT features{};
    features.sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT;
    features.pNext = &debug;
    features.enabledValidationFeatureCount = 1;
    features.pEnabledValidationFeatures = &kSynchronization;
    VkInstanceCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
    info.pApplicationInfo = &application;
    if (validation) {
        info.pNext = &features;
        info.enabledLayerCount = 1;
        info.ppEnabledLayerNames = &kValidationLayer;
        info.enabledExtensionCount = static_cast<uint32_t>(kExtensions.size());
        info.ppEnabledExtensionNames = kExtensions.data();
    }
    const VkResult made = vkCreateInstance(&info, nullptr, &instance_);
    if (made == VK_ERROR_INCOMPATIBLE_DRIVER) {
        throw Error(ExitCode::device,
                    "no Vulkan driver is installed; for a GPU install its vendor's driver, for "
                    "the CPU driver lavapipe on Debian: apt-get install mesa-vulkan-drivers");
    }
    vk_check(made, "vkCreateInstance");
    if (validation) {
        const auto create = reinterpret_cast<PFN_vkCreateDebugUtilsMessengerEXT>(
            vkGetInstanceProcAddr(instance_, "vkCreateDebugUtilsMessengerEXT"));
        vk_check(create(instance_, &debug, nullptr, &messenger_), "vkCreateDebugUtilsMessengerEXT");
    }
}

Instance::~Instance() {
    if (messenger_ != VK_NULL_HANDLE) {
        const auto destroy = reinterpret_cast<PFN_vkDestroyDebugUtilsMessengerEXT>(
            vkGetInstanceProcAddr(instance_, "vkDestroyDebugUtilsMessengerEXT"));
        destroy(instance_, messenger_, nullptr);
    }
    vkDestroyInstance(instance_, nullptr);
}

std::vector<VkPhysicalDevice> Instance::physical_devices() const {
    uint32_t count = 0;
    const VkResult result = vkEnumeratePhysicalDevices(instance_, &count, nullptr);
    if (result == VK_ERROR_INITIALIZATION_FAILED) {
        return {};
    }
    vk_check(result, "vkEnumeratePhysicalDevices");
    std::vector<VkPhysicalDevice> devices(count);
    vk_check(vkEnumeratePhysicalDevices(instance_, &count, devices.data()),
             "vkEnumeratePhysicalDevices");
    devices.resize(count);
    return devices;
}

std::shared_ptr<Instance> Instance::shared() {
    static std::mutex mutex;
    static std::weak_ptr<Instance> current;
    const std::lock_guard lock(mutex);
    auto instance = current.lock();
    if (!instance) {
        instance = std::make_shared<Instance>();
        current = instance;
    }
    return instance;
}

std::vector<std::string> validation_messages() {
    const std::lock_guard lock(g_mutex);
    return g_messages;
}

void check_validation() {
    const std::lock_guard lock(g_mutex);
    if (!g_messages.empty()) {
        throw Error(ExitCode::device, "the Vulkan validation layer reported " +
                                          std::to_string(g_messages.size()) +
                                          " problem(s); the first: " + g_messages.front());
    }
}

} // namespace ecir
