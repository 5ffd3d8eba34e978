#pragma once
#include <vulkan/vulkan.h>

#include <utility>

namespace ecir {

/// Throws Error(device), or Error(resources) for the out-of-memory results, naming the call and the
/// result. Used on every Vulkan call in every build type.
void vk_check(VkResult result, const char* call);

/// Owns one Vulkan object; the deleter is bound when it is made.
template <typename T> class Handle {
public:
    Handle() = default;
    template <typename Owner>
    Handle(T object, Owner owner, void(VKAPI_PTR* destroy)(Owner, T, const VkAllocationCallbacks*))
        : object_(object), owner_(reinterpret_cast<void*>(owner)),
          destroy_(reinterpret_cast<Destroy>(destroy)) {}
    ~Handle() { reset(); }
    Handle(Handle&& other) noexcept { swap(other); }
    Handle& operator=(Handle&& other) noexcept {
        swap(other);
        return *this;
    }
    Handle(const Handle&) = delete;
    Handle& operator=(const Handle&) = delete;

    [[nodiscard]] T get() const { return object_; }
    explicit operator bool() const { return object_ != VK_NULL_HANDLE; }
    void reset() {
        if (object_ != VK_NULL_HANDLE) {
            destroy_(owner_, object_, nullptr);
        }
        object_ = VK_NULL_HANDLE;
    }

private:
    using Destroy = void(VKAPI_PTR*)(void*, T, const VkAllocationCallbacks*);
    void swap(Handle& other) noexcept {
        std::swap(object_, other.object_);
        std::swap(owner_, other.owner_);
        std::swap(destroy_, other.destroy_);
    }
    T object_ = VK_NULL_HANDLE;
    void* owner_ = nullptr;
    Destroy destroy_ = nullptr;
};

} // namespace ecir
