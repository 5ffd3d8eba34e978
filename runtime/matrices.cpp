#include "runtime/matrices.hpp"

#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "runtime/kernel.hpp"

namespace ecir {
namespace {

bool has_extension(VkPhysicalDevice device, std::string_view wanted) {
    uint32_t count = 0;
    vk_check(vkEnumerateDeviceExtensionProperties(device, nullptr, &count, nullptr),
             "vkEnumerateDeviceExtensionProperties");
    std::vector<VkExtensionProperties> extensions(count);
    vk_check(vkEnumerateDeviceExtensionProperties(device, nullptr, &count, extensions.data()),
             "vkEnumerateDeviceExtensionProperties");
    return std::ranges::any_of(extensions, [&](const VkExtensionProperties& extension) {
        return extension.extensionName == wanted;
    });
}

/// Whether all subgroups of a device have the size that it states, kernels may ask for full ones,
/// and the memory model that cooperative matrices take is there.
bool is_fit(VkPhysicalDevice device, uint32_t version) {
    if (version < VK_API_VERSION_1_2 ||
        !has_extension(device, VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME)) {
        return false;
    }
    VkPhysicalDeviceSubgroupSizeControlPropertiesEXT sizes{};
    sizes.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_PROPERTIES_EXT;
    VkPhysicalDeviceProperties2 properties{};
    properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
    properties.pNext = &sizes;
    vkGetPhysicalDeviceProperties2(device, &properties);

    VkPhysicalDeviceSubgroupSizeControlFeaturesEXT subgroups{};
    subgroups.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES_EXT;
    VkPhysicalDeviceVulkan12Features features12{};
    features12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
    features12.pNext = &subgroups;
    VkPhysicalDeviceFeatures2 features{};
    features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    features.pNext = &features12;
    vkGetPhysicalDeviceFeatures2(device, &features);
    return features12.vulkanMemoryModel == VK_TRUE && subgroups.computeFullSubgroups == VK_TRUE &&
           sizes.minSubgroupSize == sizes.maxSubgroupSize;
}

bool usable(uint32_t size) {
    return size == 8 || size == 16;
}

/// The shapes of a form; `Properties` is the extension's structure, whose fields have the same
/// names and values in both.
template <typename Properties, typename Query>
std::vector<Properties> shapes(VkInstance instance, VkPhysicalDevice device, const char* query_name,
                               VkStructureType type) {
    const auto query = reinterpret_cast<Query>(vkGetInstanceProcAddr(instance, query_name));
    uint32_t count = 0;
    if (query == nullptr || query(device, &count, nullptr) != VK_SUCCESS) {
        return {};
    }
    Properties empty{};
    empty.sType = type;
    std::vector<Properties> found(count, empty);
    if (query(device, &count, found.data()) != VK_SUCCESS) {
        return {};
    }
    return found;
}

void consider(Matrices& best, const Matrices& shape) {
    if (usable(shape.m) && usable(shape.n) && usable(shape.k) &&
        shape.m * shape.n * shape.k > best.m * best.n * best.k) {
        best = shape;
    }
}

#ifdef VK_KHR_cooperative_matrix
Matrices find_khr(VkInstance instance, VkPhysicalDevice device) {
    VkPhysicalDeviceCooperativeMatrixFeaturesKHR matrix{};
    matrix.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_FEATURES_KHR;
    VkPhysicalDeviceFeatures2 features{};
    features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    features.pNext = &matrix;
    vkGetPhysicalDeviceFeatures2(device, &features);
    Matrices best;
    if (matrix.cooperativeMatrix != VK_TRUE) {
        return best;
    }
    for (const auto& shape : shapes<VkCooperativeMatrixPropertiesKHR,
                                    PFN_vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR>(
             instance, device, "vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR",
             VK_STRUCTURE_TYPE_COOPERATIVE_MATRIX_PROPERTIES_KHR)) {
        if (shape.AType == VK_COMPONENT_TYPE_FLOAT16_KHR &&
            shape.BType == VK_COMPONENT_TYPE_FLOAT16_KHR &&
            shape.CType == VK_COMPONENT_TYPE_FLOAT32_KHR &&
            shape.ResultType == VK_COMPONENT_TYPE_FLOAT32_KHR &&
            shape.scope == VK_SCOPE_SUBGROUP_KHR) {
            consider(best, {Matrices::Form::khr, shape.MSize, shape.NSize, shape.KSize});
        }
    }
    return best;
}
#endif

Matrices find_nv(VkInstance instance, VkPhysicalDevice device) {
    VkPhysicalDeviceCooperativeMatrixFeaturesNV matrix{};
    matrix.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_FEATURES_NV;
    VkPhysicalDeviceFeatures2 features{};
    features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    features.pNext = &matrix;
    vkGetPhysicalDeviceFeatures2(device, &features);
    Matrices best;
    if (matrix.cooperativeMatrix != VK_TRUE) {
        return best;
    }
    for (const auto& shape : shapes<VkCooperativeMatrixPropertiesNV,
                                    PFN_vkGetPhysicalDeviceCooperativeMatrixPropertiesNV>(
             instance, device, "vkGetPhysicalDeviceCooperativeMatrixPropertiesNV",
             VK_STRUCTURE_TYPE_COOPERATIVE_MATRIX_PROPERTIES_NV)) {
        if (shape.AType == VK_COMPONENT_TYPE_FLOAT16_NV &&
            shape.BType == VK_COMPONENT_TYPE_FLOAT16_NV &&
            shape.CType == VK_COMPONENT_TYPE_FLOAT32_NV &&
            shape.DType == VK_COMPONENT_TYPE_FLOAT32_NV && shape.scope == VK_SCOPE_SUBGROUP_NV) {
            consider(best, {Matrices::Form::nv, shape.MSize, shape.NSize, shape.KSize});
        }
    }
    return best;
}

} // namespace

std::string_view form_name(Matrices::Form form) {
    constexpr std::array<std::string_view, 3> kNames = {"none", "khr", "nv"};
    return kNames.at(static_cast<size_t>(form));
}

MatrixFeatures::MatrixFeatures(Matrices::Form form) {
    subgroups_.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES_EXT;
    subgroups_.computeFullSubgroups = VK_TRUE;
#ifdef VK_KHR_cooperative_matrix
    if (form == Matrices::Form::khr) {
        khr_.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_FEATURES_KHR;
        khr_.cooperativeMatrix = VK_TRUE;
        khr_.pNext = &subgroups_;
        extensions_ = {VK_KHR_COOPERATIVE_MATRIX_EXTENSION_NAME,
                       VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME};
        chain_ = &khr_;
    }
#endif
    if (form == Matrices::Form::nv) {
        nv_.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_MATRIX_FEATURES_NV;
        nv_.cooperativeMatrix = VK_TRUE;
        nv_.pNext = &subgroups_;
        extensions_ = {VK_NV_COOPERATIVE_MATRIX_EXTENSION_NAME,
                       VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME};
        chain_ = &nv_;
    }
}

Matrices find_matrices(VkInstance instance, VkPhysicalDevice device) {
    VkPhysicalDeviceProperties basic{};
    vkGetPhysicalDeviceProperties(device, &basic);
    if (!is_fit(device, basic.apiVersion)) {
        return {};
    }
    Matrices found;
#ifdef VK_KHR_cooperative_matrix
    if (is_embedded("conv_matrix_khr") &&
        has_extension(device, VK_KHR_COOPERATIVE_MATRIX_EXTENSION_NAME)) {
        found = find_khr(instance, device);
    }
#endif
    if (found.form == Matrices::Form::none && is_embedded("conv_matrix_nv") &&
        has_extension(device, VK_NV_COOPERATIVE_MATRIX_EXTENSION_NAME)) {
        found = find_nv(instance, device);
    }
    return found;
}

} // namespace ecir
