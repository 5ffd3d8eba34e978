#include "runtime/buffer.hpp"

#include <algorithm>
#include <string>

#include "runtime/device.hpp"
#include "runtime/error.hpp"

namespace ecir {

std::string mebibytes(uint64_t bytes) {
    return std::to_string((bytes + (1U << 20) - 1) >> 20) + " MiB";
}

Buffer::Buffer(Device& device, VkDeviceSize bytes, Place place) : size_(bytes) {
    const DeviceInfo& info = device.info();
    if (bytes > info.max_allocation || bytes > info.heap_bytes) {
        throw Error(ExitCode::resources,
                    "this needs " + mebibytes(bytes) + " of device memory in one piece, but " +
                        info.name + " gives " +
                        mebibytes(std::min(info.max_allocation, info.heap_bytes)) +
                        "; use a smaller --size, fewer --frames, or another device (-g)");
    }
    VkBufferCreateInfo create{};
    create.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
    create.size = bytes;
    create.usage = VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    const bool on_device = place == Place::device;
    if (on_device) {
        create.usage |= VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT |
                        VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT;
        if (info.buffer_address) {
            create.usage |= VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
        }
    }
    VkBuffer buffer = VK_NULL_HANDLE;
    vk_check(vkCreateBuffer(device.handle(), &create, nullptr, &buffer), "vkCreateBuffer");
    buffer_ = Handle<VkBuffer>(buffer, device.handle(), vkDestroyBuffer);

    VkMemoryRequirements needs{};
    vkGetBufferMemoryRequirements(device.handle(), buffer, &needs);
    VkMemoryAllocateFlagsInfo flags{};
    flags.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO;
    flags.flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT;
    VkMemoryAllocateInfo allocate{};
    allocate.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
    allocate.allocationSize = needs.size;
    if (on_device && info.buffer_address) {
        allocate.pNext = &flags;
    }
    constexpr auto kVisible =
        VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    switch (place) {
    case Place::device:
        allocate.memoryTypeIndex =
            device.memory_type(needs.memoryTypeBits, 0, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
        break;
    case Place::upload:
        allocate.memoryTypeIndex = device.memory_type(needs.memoryTypeBits, kVisible, 0);
        break;
    case Place::readback:
        allocate.memoryTypeIndex =
            device.memory_type(needs.memoryTypeBits, kVisible, VK_MEMORY_PROPERTY_HOST_CACHED_BIT);
        break;
    }
    VkDeviceMemory memory = VK_NULL_HANDLE;
    const VkResult result = vkAllocateMemory(device.handle(), &allocate, nullptr, &memory);
    if (result == VK_ERROR_OUT_OF_DEVICE_MEMORY || result == VK_ERROR_OUT_OF_HOST_MEMORY) {
        throw Error(ExitCode::resources, info.name + " has no " + mebibytes(needs.size) +
                                             " left of its " + mebibytes(info.heap_bytes) +
                                             "; use a smaller --size or fewer --frames");
    }
    vk_check(result, "vkAllocateMemory");
    memory_ = Handle<VkDeviceMemory>(memory, device.handle(), vkFreeMemory);
    vk_check(vkBindBufferMemory(device.handle(), buffer, memory, 0), "vkBindBufferMemory");

    if (on_device && info.buffer_address) {
        VkBufferDeviceAddressInfo query{};
        query.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO;
        query.buffer = buffer;
        address_ = vkGetBufferDeviceAddress(device.handle(), &query);
    }
    if (!on_device) {
        void* pointer = nullptr;
        vk_check(vkMapMemory(device.handle(), memory, 0, VK_WHOLE_SIZE, 0, &pointer),
                 "vkMapMemory");
        mapped_ = static_cast<std::byte*>(pointer);
    }
}

std::shared_ptr<const Buffer> upload(Device& device, std::span<const std::byte> bytes) {
    // Vulkan has no empty buffers, and copies go by 4 bytes.
    const VkDeviceSize size = std::max<VkDeviceSize>((bytes.size() + 3) / 4 * 4, 4);
    Buffer staging(device, size, Buffer::Place::upload);
    std::ranges::copy(bytes, staging.mapped());
    auto result = std::make_shared<const Buffer>(device, size, Buffer::Place::device);

    VkCommandPoolCreateInfo pool_info{};
    pool_info.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
    pool_info.queueFamilyIndex = device.queue_family();
    VkCommandPool pool_raw = VK_NULL_HANDLE;
    vk_check(vkCreateCommandPool(device.handle(), &pool_info, nullptr, &pool_raw),
             "vkCreateCommandPool");
    const Handle<VkCommandPool> pool(pool_raw, device.handle(), vkDestroyCommandPool);
    VkCommandBufferAllocateInfo allocate{};
    allocate.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
    allocate.commandPool = pool.get();
    allocate.commandBufferCount = 1;
    VkCommandBuffer commands = VK_NULL_HANDLE;
    vk_check(vkAllocateCommandBuffers(device.handle(), &allocate, &commands),
             "vkAllocateCommandBuffers");
    VkCommandBufferBeginInfo begin{};
    begin.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
    begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
    vk_check(vkBeginCommandBuffer(commands, &begin), "vkBeginCommandBuffer");
    const VkBufferCopy copy{0, 0, size};
    vkCmdCopyBuffer(commands, staging.handle(), result->handle(), 1, &copy);
    vk_check(vkEndCommandBuffer(commands), "vkEndCommandBuffer");
    device.submit({&commands, 1});
    return result;
}

} // namespace ecir
