#pragma once
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "runtime/vk.hpp"

namespace ecir {

/// Cooperative matrices of a device: products of m x k and k x n matrices, with factors in float16
/// and sums in float32, that a subgroup computes together.
struct Matrices {
    /// The extension whose form kernels take.
    enum class Form { none, khr, nv };
    Form form = Form::none;
    uint32_t m = 0;
    uint32_t n = 0;
    uint32_t k = 0;
};

/// "khr" or "nv", by which the kernels of a form are named; "none".
std::string_view form_name(Matrices::Form form);

/// What a device and its driver have that this library's kernels can use: m, n and k are 8 or 16,
/// the largest product of these first. The KHR form goes before NVIDIA's; a form that the GLSL
/// compiler of the build did not know is not taken, and none where the size of subgroups may vary
/// from kernel to kernel, or where kernels cannot ask for full ones.
Matrices find_matrices(VkInstance instance, VkPhysicalDevice device);

/// What a device is opened with so that kernels may use matrices of a form.
class MatrixFeatures {
public:
    explicit MatrixFeatures(Matrices::Form form);
    MatrixFeatures(const MatrixFeatures&) = delete;
    MatrixFeatures& operator=(const MatrixFeatures&) = delete;

    [[nodiscard]] std::span<const char* const> extensions() const { return extensions_; }
    /// For a pNext; it lives as long as this.
    [[nodiscard]] void* chain() const { return chain_; }
    [[nodiscard]] VkBool32 memory_model() const { return chain_ != nullptr ? VK_TRUE : VK_FALSE; }

private:
    std::vector<const char*> extensions_;
    void* chain_ = nullptr;
    VkPhysicalDeviceSubgroupSizeControlFeaturesEXT subgroups_{};
#ifdef VK_KHR_cooperative_matrix
    VkPhysicalDeviceCooperativeMatrixFeaturesKHR khr_{};
#endif
    VkPhysicalDeviceCooperativeMatrixFeaturesNV nv_{};
};

} // namespace ecir
