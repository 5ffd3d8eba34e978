#include "runtime/device.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cstdlib>

#include "runtime/driver_threads.hpp"
#include "runtime/error.hpp"
#include "runtime/kernel.hpp"

namespace ecir {
namespace {

const char* type_name(VkPhysicalDeviceType type) {
    switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
        return "discrete GPU";
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
        return "integrated GPU";
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
        return "virtual GPU";
    case VK_PHYSICAL_DEVICE_TYPE_CPU:
        return "CPU";
    default:
        return "other";
    }
}

/// Storage buffers that the kernels with most of them bind (shaders/prior.comp, prior_frame.comp).
constexpr uint32_t kStorageBuffers = 9;

/// Order of preference for the default: the lower the better.
std::pair<bool, ptrdiff_t> rank(const DeviceInfo& info) {
    constexpr std::array<const char*, 5> kOrder = {"discrete GPU", "integrated GPU", "virtual GPU",
                                                   "other", "CPU"};
    return {!info.lacks.empty(), std::ranges::find(kOrder, info.type) - kOrder.begin()};
}

std::string lower(std::string text) {
    std::ranges::transform(text, text.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return text;
}

std::vector<VkQueueFamilyProperties> queue_families(VkPhysicalDevice physical) {
    uint32_t count = 0;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, nullptr);
    std::vector<VkQueueFamilyProperties> families(count);
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families.data());
    return families;
}

constexpr uint32_t kMostQueues = 2;

/// The first family with compute and several queues, else the first with compute, or UINT32_MAX.
uint32_t compute_family(VkPhysicalDevice physical) {
    const auto families = queue_families(physical);
    for (const uint32_t least : {kMostQueues, 1U}) {
        for (uint32_t i = 0; i < families.size(); ++i) {
            if ((families[i].queueFlags & VK_QUEUE_COMPUTE_BIT) != 0 &&
                families[i].queueCount >= least) {
                return i;
            }
        }
    }
    return UINT32_MAX;
}

uint32_t wanted_queues(const DeviceInfo& info, uint32_t there) {
    const char* value = std::getenv("ECIR_QUEUES");
    if (value == nullptr) {
        return info.is_cpu ? 1 : std::min(there, kMostQueues);
    }
    const std::string_view text(value);
    if (text != "1" && text != "2") {
        throw Error(ExitCode::usage, "ECIR_QUEUES is " + std::string(text) + "; it can be 1 or 2");
    }
    return text == "1" ? 1 : 2;
}

/// What of it a device has too little of.
std::string lacking(const VkPhysicalDeviceProperties& properties, bool has_queue,
                    uint32_t storage_buffers) {
    if (properties.apiVersion < VK_API_VERSION_1_1) {
        return "Vulkan 1.1";
    }
    if (!has_queue) {
        return "a compute queue";
    }
    if (storage_buffers < kStorageBuffers) {
        return std::to_string(kStorageBuffers) + " storage buffers a kernel (it has " +
               std::to_string(storage_buffers) + "), so some models do not run on it";
    }
    return {};
}

DeviceInfo describe(VkInstance instance, VkPhysicalDevice physical, uint32_t index) {
    VkPhysicalDeviceProperties basic{};
    vkGetPhysicalDeviceProperties(physical, &basic);
    const bool has12 = basic.apiVersion >= VK_API_VERSION_1_2;

    VkPhysicalDeviceDriverProperties driver{};
    driver.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES;
    VkPhysicalDeviceMaintenance3Properties maintenance{};
    maintenance.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES;
    maintenance.pNext = has12 ? &driver : nullptr;
    VkPhysicalDeviceSubgroupProperties subgroup{};
    subgroup.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES;
    subgroup.pNext = &maintenance;
    VkPhysicalDeviceProperties2 properties{};
    properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
    properties.pNext = &subgroup;
    vkGetPhysicalDeviceProperties2(physical, &properties);

    VkPhysicalDeviceVulkan12Features features12{};
    features12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
    VkPhysicalDevice16BitStorageFeatures storage16{};
    storage16.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_16BIT_STORAGE_FEATURES;
    storage16.pNext = has12 ? &features12 : nullptr;
    VkPhysicalDeviceFeatures2 features{};
    features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    features.pNext = &storage16;
    vkGetPhysicalDeviceFeatures2(physical, &features);

    VkPhysicalDeviceMemoryProperties memory{};
    vkGetPhysicalDeviceMemoryProperties(physical, &memory);

    DeviceInfo info;
    info.index = index;
    info.name = basic.deviceName;
    info.type = type_name(basic.deviceType);
    info.is_cpu = basic.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU;
    info.driver = has12 ? std::string(driver.driverName) + " " + driver.driverInfo
                        : "version " + std::to_string(basic.driverVersion);
    info.subgroup_size = subgroup.subgroupSize;
    info.buffer_address = has12 && features12.bufferDeviceAddress == VK_TRUE &&
                          features.features.shaderInt64 == VK_TRUE &&
                          features12.scalarBlockLayout == VK_TRUE;
    info.storage16 = storage16.storageBuffer16BitAccess == VK_TRUE;
    info.float16 = has12 && features12.shaderFloat16 == VK_TRUE;
    if (has_float16(info)) {
        info.matrices = find_matrices(instance, physical);
    }
    info.timestamp_ns = static_cast<double>(basic.limits.timestampPeriod);
    const uint32_t family = compute_family(physical);
    const bool has_queue = family != UINT32_MAX;
    const uint32_t bits = has_queue ? queue_families(physical)[family].timestampValidBits : 0;
    info.timestamp_mask = bits == 0 ? 0 : UINT64_MAX >> (64 - bits);
    info.max_storage_buffers = std::min(basic.limits.maxPerStageDescriptorStorageBuffers,
                                        basic.limits.maxDescriptorSetStorageBuffers);
    info.max_invocations = basic.limits.maxComputeWorkGroupInvocations;
    info.lacks = lacking(basic, has_queue, info.max_storage_buffers);
    info.max_storage_range = basic.limits.maxStorageBufferRange;
    info.max_uniform_range = basic.limits.maxUniformBufferRange;
    info.max_shared_bytes = basic.limits.maxComputeSharedMemorySize;
    info.max_push_bytes = basic.limits.maxPushConstantsSize;
    std::ranges::copy(basic.limits.maxComputeWorkGroupCount, info.max_groups.begin());
    info.max_allocation = maintenance.maxMemoryAllocationSize;
    info.uniform_alignment = basic.limits.minUniformBufferOffsetAlignment;
    info.storage_alignment = basic.limits.minStorageBufferOffsetAlignment;
    for (uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
        if ((memory.memoryTypes[i].propertyFlags & VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT) != 0) {
            info.heap_bytes =
                std::max(info.heap_bytes, memory.memoryHeaps[memory.memoryTypes[i].heapIndex].size);
        }
    }
    return info;
}

std::vector<DeviceInfo> describe_all(const Instance& instance) {
    std::vector<DeviceInfo> devices;
    for (const VkPhysicalDevice physical : instance.physical_devices()) {
        devices.push_back(
            describe(instance.handle(), physical, static_cast<uint32_t>(devices.size())));
    }
    if (devices.empty()) {
        throw Error(ExitCode::device,
                    "no Vulkan device was found; for a GPU install its vendor's driver, for the "
                    "CPU driver lavapipe on Debian: apt-get install mesa-vulkan-drivers");
    }
    std::ranges::min_element(devices, {}, rank)->is_default = true;
    return devices;
}

size_t choose(const std::vector<DeviceInfo>& devices, const std::string& selector) {
    if (selector.empty()) {
        const auto chosen = std::ranges::find_if(devices, &DeviceInfo::is_default);
        return static_cast<size_t>(chosen - devices.begin());
    }
    size_t index = 0;
    const char* end = selector.data() + selector.size();
    const auto [stop, error] = std::from_chars(selector.data(), end, index);
    const bool is_number = error == std::errc{} && stop == end;
    if (is_number && index < devices.size()) {
        return index;
    }
    if (!is_number) {
        for (const DeviceInfo& device : devices) {
            if (lower(device.name).find(lower(selector)) != std::string::npos) {
                return device.index;
            }
        }
    }
    std::string message = "no Vulkan device matches '" + selector + "'; those here:";
    for (const DeviceInfo& device : devices) {
        message += (&device == &devices.front() ? " " : ", ") + std::to_string(device.index) + " " +
                   device.name + " (" + device.type + ")";
    }
    throw Error(ExitCode::device, message);
}

} // namespace

std::vector<DeviceInfo> Device::list() {
    return describe_all(*Instance::shared());
}

std::shared_ptr<Device> Device::open(const std::string& selector, Precision precision) {
    auto instance = Instance::shared();
    const auto devices = describe_all(*instance);
    const size_t index = choose(devices, selector);
    const auto physical = instance->physical_devices();
    return std::shared_ptr<Device>(
        new Device(instance, physical[index], devices[index], precision));
}

std::shared_ptr<Device> Device::twin() const {
    return std::shared_ptr<Device>(new Device(instance_, physical_, info_, precision_));
}

Device::Device(std::shared_ptr<Instance> instance, VkPhysicalDevice physical, DeviceInfo info,
               Precision precision)
    : instance_(std::move(instance)), physical_(physical), info_(std::move(info)),
      precision_(precision) {
    vkGetPhysicalDeviceMemoryProperties(physical_, &memory_);
    queue_family_ = compute_family(physical_);
    VkPhysicalDeviceProperties properties{};
    vkGetPhysicalDeviceProperties(physical_, &properties);
    if (queue_family_ == UINT32_MAX || properties.apiVersion < VK_API_VERSION_1_1) {
        throw Error(ExitCode::device,
                    info_.name + " lacks " + info_.lacks + "; choose another with -g");
    }
    const uint32_t there = queue_families(physical_)[queue_family_].queueCount;
    const uint32_t wanted = wanted_queues(info_, there);
    const std::array<float, kMostQueues> priorities{1, 1};
    VkDeviceQueueCreateInfo queue{};
    queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
    queue.queueFamilyIndex = queue_family_;
    queue.queueCount = std::min(there, wanted);
    queue.pQueuePriorities = priorities.data();

    const VkBool32 address = info_.buffer_address ? VK_TRUE : VK_FALSE;
    const VkBool32 half = has_float16(info_) ? VK_TRUE : VK_FALSE;
    VkPhysicalDevice16BitStorageFeatures storage16{};
    storage16.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_16BIT_STORAGE_FEATURES;
    storage16.storageBuffer16BitAccess = half;
    VkPhysicalDeviceVulkan12Features features12{};
    features12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
    features12.pNext = &storage16;
    features12.bufferDeviceAddress = address;
    features12.scalarBlockLayout = address;
    features12.shaderFloat16 = half;
    const MatrixFeatures matrices(info_.matrices.form);
    features12.vulkanMemoryModel = matrices.memory_model();
    storage16.pNext = matrices.chain();
    VkPhysicalDeviceFeatures features{};
    features.shaderInt64 = address;
    VkDeviceCreateInfo create{};
    create.enabledExtensionCount = static_cast<uint32_t>(matrices.extensions().size());
    create.ppEnabledExtensionNames = matrices.extensions().data();
    create.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
    create.queueCreateInfoCount = 1;
    create.pQueueCreateInfos = &queue;
    if (address == VK_TRUE || half == VK_TRUE) { // either is known of Vulkan 1.2 devices only
        create.pNext = &features12;
        create.pEnabledFeatures = &features;
    }
    const DriverThreads threads;
    vk_check(vkCreateDevice(physical_, &create, nullptr, &device_), "vkCreateDevice");
    if (info_.is_cpu) {
        threads.pin();
    }
    for (uint32_t i = 0; i < wanted; ++i) {
        VkQueue handle = VK_NULL_HANDLE;
        vkGetDeviceQueue(device_, queue_family_, i % queue.queueCount, &handle);
        queues_.push_back(handle);
    }

    fence_ = make_fence();
    kernels_ = std::make_unique<KernelCache>(*this);
}

Device::~Device() {
    kernels_.reset();
    fence_.reset();
    vkDestroyDevice(device_, nullptr);
}

const Kernel& Device::kernel(std::string_view shader, std::span<const uint32_t> constants,
                             uint32_t bindings, uint32_t push_bytes) {
    const Kernel& kernel = kernels_->get(shader, constants);
    const Reflection& found = kernel.reflection();
    if (found.bindings.size() != bindings || found.push_bytes != push_bytes) {
        throw Error(ExitCode::device, "shader " + std::string(shader) + " declares " +
                                          std::to_string(found.bindings.size()) + " bindings and " +
                                          std::to_string(found.push_bytes) +
                                          " push-constant bytes, but its layer gives " +
                                          std::to_string(bindings) + " and " +
                                          std::to_string(push_bytes));
    }
    return kernel;
}

void Device::on_compiling(std::function<void()> tell) {
    kernels_->on_compiling(std::move(tell));
}

uint32_t Device::memory_type(uint32_t types, VkMemoryPropertyFlags wanted,
                             VkMemoryPropertyFlags liked) const {
    for (const VkMemoryPropertyFlags flags : {wanted | liked, wanted}) {
        for (uint32_t i = 0; i < memory_.memoryTypeCount; ++i) {
            const bool allowed = (types >> i & 1U) != 0;
            if (allowed && (memory_.memoryTypes[i].propertyFlags & flags) == flags) {
                return i;
            }
        }
    }
    throw Error(ExitCode::device, info_.name + " has no memory of the kind that is needed");
}

Handle<VkFence> Device::make_fence() const {
    VkFenceCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
    VkFence fence = VK_NULL_HANDLE;
    vk_check(vkCreateFence(device_, &info, nullptr, &fence), "vkCreateFence");
    return {fence, device_, vkDestroyFence};
}

void Device::submit(std::span<const VkCommandBuffer> commands, uint32_t queue) {
    start(commands, fence_.get(), queue);
    wait(fence_.get());
}

void Device::start(std::span<const VkCommandBuffer> commands, VkFence fence, uint32_t queue) {
    const VkQueue taker = queues_.at(queue);
    for (size_t i = 0; i < commands.size(); ++i) {
        VkSubmitInfo info{};
        info.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
        info.commandBufferCount = 1;
        info.pCommandBuffers = &commands[i];
        const bool last = i + 1 == commands.size();
        const VkResult result = vkQueueSubmit(taker, 1, &info, last ? fence : VK_NULL_HANDLE);
        if (result != VK_SUCCESS) { // those before it are under way, which nobody would wait for
            (void)vkQueueWaitIdle(taker);
            vk_check(result, "vkQueueSubmit");
        }
    }
}

void Device::wait(VkFence fence) {
    vk_check(vkWaitForFences(device_, 1, &fence, VK_TRUE, UINT64_MAX), "vkWaitForFences");
    vk_check(vkResetFences(device_, 1, &fence), "vkResetFences");
    check_validation();
}

} // namespace ecir
