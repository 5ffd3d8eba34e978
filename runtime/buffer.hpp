#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "runtime/vk.hpp"

namespace ecir {

class Device;

/// One Vulkan buffer with its own memory.
class Buffer {
public:
    enum class Place {
        device,   ///< fastest for kernels; filled and read through staging copies
        upload,   ///< mapped, written by the host
        readback, ///< mapped, read by the host
    };

    Buffer() = default;
    /// Throws Error(resources) with the wanted and the available bytes when it does not fit.
    Buffer(Device& device, VkDeviceSize bytes, Place place);

    [[nodiscard]] VkBuffer handle() const { return buffer_.get(); }
    [[nodiscard]] VkDeviceSize size() const { return size_; }
    /// Device address for kernels that read by pointer; 0 where the device has none.
    [[nodiscard]] uint64_t address() const { return address_; }
    /// Host pointer of an upload or readback buffer.
    [[nodiscard]] std::byte* mapped() const { return mapped_; }
    explicit operator bool() const { return static_cast<bool>(buffer_); }

private:
    Handle<VkDeviceMemory> memory_;
    Handle<VkBuffer> buffer_;
    VkDeviceSize size_ = 0;
    uint64_t address_ = 0;
    std::byte* mapped_ = nullptr;
};

/// A device buffer holding `bytes`, copied there through staging before this returns.
std::shared_ptr<const Buffer> upload(Device& device, std::span<const std::byte> bytes);

template <typename T>
std::shared_ptr<const Buffer> upload(Device& device, std::span<const T> values) {
    return upload(device, std::as_bytes(values));
}

/// For messages: "12 MiB", rounded up.
std::string mebibytes(uint64_t bytes);

} // namespace ecir
