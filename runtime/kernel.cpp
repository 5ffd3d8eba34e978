#include "runtime/kernel.hpp"

#include <spirv_cross/spirv_cross_c.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <utility>

#include "runtime/cache_file.hpp"
#include "runtime/device.hpp"
#include "runtime/error.hpp"

namespace ecir {
namespace {

[[noreturn]] void bad_shader(std::string_view name, const std::string& what) {
    throw Error(ExitCode::device, "shader " + std::string(name) + ": " + what);
}

void spvc_check(spvc_result result, std::string_view name, const char* call) {
    if (result != SPVC_SUCCESS) {
        bad_shader(name, std::string(call) + " failed");
    }
}

/// The module with vectors for the types of cooperative matrices, which Debian 12's SPIRV-Cross
/// does not know: no binding or push constant has such a type.
std::vector<uint32_t> without_matrices(std::span<const uint32_t> spirv) {
    constexpr uint32_t kHeaderWords = 5;
    constexpr uint32_t kTypeVector = 23;
    constexpr uint32_t kTypeMatrixNv = 5358;
    constexpr uint32_t kTypeMatrixKhr = 4456;
    constexpr uint32_t kNop = 1U << 16;
    std::vector<uint32_t> words(spirv.begin(), spirv.end());
    for (size_t at = kHeaderWords; at < words.size();) {
        const uint32_t code = words[at] & 0xFFFFU;
        const uint32_t count = words[at] >> 16;
        if (count == 0) {
            break; // not SPIR-V, which the parser says
        }
        if ((code == kTypeMatrixNv || code == kTypeMatrixKhr) && at + count <= words.size()) {
            words[at] = 4U << 16 | kTypeVector; // its id and component type are the same operands
            words[at + 3] = 2;
            std::fill(words.begin() + static_cast<std::ptrdiff_t>(at) + 4,
                      words.begin() + static_cast<std::ptrdiff_t>(at + count), kNop);
        }
        at += count;
    }
    return words;
}

Handle<VkPipeline> make_pipeline(VkDevice vk, VkPipelineLayout layout,
                                 std::span<const uint32_t> spirv,
                                 std::span<const uint32_t> constants, bool full_subgroups,
                                 VkPipelineCache cache) {
    VkShaderModuleCreateInfo module_info{};
    module_info.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
    module_info.codeSize = spirv.size_bytes();
    module_info.pCode = spirv.data();
    VkShaderModule module_raw = VK_NULL_HANDLE;
    vk_check(vkCreateShaderModule(vk, &module_info, nullptr, &module_raw), "vkCreateShaderModule");
    const Handle<VkShaderModule> shader(module_raw, vk, vkDestroyShaderModule);

    std::vector<VkSpecializationMapEntry> entries;
    for (uint32_t i = 0; i < constants.size(); ++i) {
        entries.push_back({i, i * 4, 4});
    }
    const VkSpecializationInfo specialization{static_cast<uint32_t>(entries.size()), entries.data(),
                                              constants.size_bytes(), constants.data()};
    VkComputePipelineCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
    info.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
    info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
    info.stage.flags =
        full_subgroups ? VK_PIPELINE_SHADER_STAGE_CREATE_REQUIRE_FULL_SUBGROUPS_BIT_EXT : 0;
    info.stage.module = shader.get();
    info.stage.pName = "main";
    info.stage.pSpecializationInfo = &specialization;
    info.layout = layout;
    VkPipeline pipeline = VK_NULL_HANDLE;
    vk_check(vkCreateComputePipelines(vk, cache, 1, &info, nullptr, &pipeline),
             "vkCreateComputePipelines");
    return {pipeline, vk, vkDestroyPipeline};
}

} // namespace

Reflection reflect(std::string_view name, std::span<const uint32_t> spirv) {
    spvc_context context_raw = nullptr;
    spvc_check(spvc_context_create(&context_raw), name, "spvc_context_create");
    const std::unique_ptr<spvc_context_s, void (*)(spvc_context)> context(context_raw,
                                                                          spvc_context_destroy);
    spvc_parsed_ir ir = nullptr;
    const std::vector<uint32_t> words = without_matrices(spirv);
    spvc_check(spvc_context_parse_spirv(context.get(), words.data(), words.size(), &ir), name,
               "spvc_context_parse_spirv");
    spvc_compiler compiler = nullptr;
    spvc_check(spvc_context_create_compiler(context.get(), SPVC_BACKEND_NONE, ir,
                                            SPVC_CAPTURE_MODE_TAKE_OWNERSHIP, &compiler),
               name, "spvc_context_create_compiler");
    spvc_resources resources = nullptr;
    spvc_check(spvc_compiler_create_shader_resources(compiler, &resources), name,
               "spvc_compiler_create_shader_resources");

    Reflection result;
    result.matrices = !std::ranges::equal(words, spirv);
    const auto list = [&](spvc_resource_type type) {
        const spvc_reflected_resource* items = nullptr;
        size_t count = 0;
        spvc_check(spvc_resources_get_resource_list_for_type(resources, type, &items, &count), name,
                   "spvc_resources_get_resource_list_for_type");
        return std::span(items, count);
    };
    for (const bool uniform : {false, true}) {
        for (const auto& item : list(uniform ? SPVC_RESOURCE_TYPE_UNIFORM_BUFFER
                                             : SPVC_RESOURCE_TYPE_STORAGE_BUFFER)) {
            if (spvc_compiler_get_decoration(compiler, item.id, SpvDecorationDescriptorSet) != 0) {
                bad_shader(name, "uses a descriptor set other than 0");
            }
            result.bindings.push_back(
                {spvc_compiler_get_decoration(compiler, item.id, SpvDecorationBinding), uniform});
        }
    }
    for (const auto type :
         {SPVC_RESOURCE_TYPE_STORAGE_IMAGE, SPVC_RESOURCE_TYPE_SAMPLED_IMAGE,
          SPVC_RESOURCE_TYPE_SEPARATE_IMAGE, SPVC_RESOURCE_TYPE_SEPARATE_SAMPLERS}) {
        if (!list(type).empty()) {
            bad_shader(name, "uses images or samplers; the runtime binds buffers only");
        }
    }
    std::ranges::sort(result.bindings, {}, &Reflection::Binding::index);
    for (uint32_t i = 0; i < result.bindings.size(); ++i) {
        if (result.bindings[i].index != i) {
            bad_shader(name, "bindings are not numbered 0, 1, 2, ...");
        }
    }
    for (const auto& item : list(SPVC_RESOURCE_TYPE_PUSH_CONSTANT)) {
        size_t bytes = 0;
        spvc_check(
            spvc_compiler_get_declared_struct_size(
                compiler, spvc_compiler_get_type_handle(compiler, item.base_type_id), &bytes),
            name, "spvc_compiler_get_declared_struct_size");
        result.push_bytes = static_cast<uint32_t>(bytes);
    }
    return result;
}

Kernel::Kernel(Device& device, std::string_view name, std::span<const uint32_t> constants,
               VkPipelineCache cache, CompileQueue& queue, bool fresh)
    : name_(name), constants_(constants.begin(), constants.end()), fresh_(fresh) {
    const auto spirv = embedded_shader(name);
    reflection_ = reflect(name, spirv);
    if (reflection_.push_bytes > device.info().max_push_bytes) {
        bad_shader(name, "needs " + std::to_string(reflection_.push_bytes) +
                             " push-constant bytes, " + device.info().name + " has " +
                             std::to_string(device.info().max_push_bytes));
    }
    const auto storage =
        std::ranges::count(reflection_.bindings, false, &Reflection::Binding::uniform);
    if (storage > device.info().max_storage_buffers) {
        throw Error(ExitCode::device, "kernel " + name_ + " binds " + std::to_string(storage) +
                                          " storage buffers, but " + device.info().name +
                                          " binds at most " +
                                          std::to_string(device.info().max_storage_buffers) +
                                          "; choose another model (-m) or another device (-g)");
    }
    const VkDevice vk = device.handle();

    std::vector<VkDescriptorSetLayoutBinding> bindings;
    for (const auto& binding : reflection_.bindings) {
        bindings.push_back({binding.index,
                            binding.uniform ? VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER_DYNAMIC
                                            : VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                            1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr});
    }
    VkDescriptorSetLayoutCreateInfo set_info{};
    set_info.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO;
    set_info.bindingCount = static_cast<uint32_t>(bindings.size());
    set_info.pBindings = bindings.data();
    VkDescriptorSetLayout set_layout = VK_NULL_HANDLE;
    vk_check(vkCreateDescriptorSetLayout(vk, &set_info, nullptr, &set_layout),
             "vkCreateDescriptorSetLayout");
    set_layout_ = Handle<VkDescriptorSetLayout>(set_layout, vk, vkDestroyDescriptorSetLayout);

    const VkPushConstantRange push{VK_SHADER_STAGE_COMPUTE_BIT, 0, reflection_.push_bytes};
    VkPipelineLayoutCreateInfo layout_info{};
    layout_info.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
    layout_info.setLayoutCount = 1;
    layout_info.pSetLayouts = &set_layout;
    layout_info.pushConstantRangeCount = reflection_.push_bytes > 0 ? 1 : 0;
    layout_info.pPushConstantRanges = &push;
    VkPipelineLayout layout = VK_NULL_HANDLE;
    vk_check(vkCreatePipelineLayout(vk, &layout_info, nullptr, &layout), "vkCreatePipelineLayout");
    layout_ = Handle<VkPipelineLayout>(layout, vk, vkDestroyPipelineLayout);

    pipeline_ =
        queue.add([vk, layout, spirv, cache, full = reflection_.matrices, values = constants_] {
            return make_pipeline(vk, layout, spirv, values, full, cache);
        });
}

KernelCache::KernelCache(Device& device)
    : device_(device), queue_(std::make_unique<CompileQueue>()),
      file_(cache_file(device.info(), ".pipelines")),
      known_(file_.empty() ? std::string() : file_ + ".list") {
    std::vector<char> data;
    if (std::ifstream in{file_, std::ios::binary}) {
        data.assign(std::istreambuf_iterator<char>(in), {});
    }
    VkPipelineCacheCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_PIPELINE_CACHE_CREATE_INFO;
    info.initialDataSize = data.size();
    info.pInitialData = data.data();
    VkPipelineCache cache = VK_NULL_HANDLE;
    vk_check(vkCreatePipelineCache(device.handle(), &info, nullptr, &cache),
             "vkCreatePipelineCache");
    cache_ = Handle<VkPipelineCache>(cache, device.handle(), vkDestroyPipelineCache);
    loaded_bytes_ = data.size();
}

KernelCache::~KernelCache() {
    queue_.reset();
    // The cache only saves time: whatever goes wrong here, the next run compiles again.
    known_.save();
    size_t size = 0;
    if (file_.empty() ||
        vkGetPipelineCacheData(device_.handle(), cache_.get(), &size, nullptr) != VK_SUCCESS ||
        size <= loaded_bytes_) {
        return;
    }
    std::vector<char> data(size);
    if (vkGetPipelineCacheData(device_.handle(), cache_.get(), &size, data.data()) != VK_SUCCESS) {
        return;
    }
    write_cache(file_, std::span(data).first(size));
}

const Kernel& KernelCache::get(std::string_view name, std::span<const uint32_t> constants) {
    auto key =
        std::pair(std::string(name), std::vector<uint32_t>(constants.begin(), constants.end()));
    const auto found = kernels_.find(key);
    if (found != kernels_.end()) {
        return found->second;
    }
    const bool fresh = known_.add(name, constants);
    if (tell_ && known_.fresh() >= kManyFreshKernels) {
        std::exchange(tell_, nullptr)();
    }
    return kernels_
        .try_emplace(std::move(key), device_, name, constants, cache_.get(), *queue_, fresh)
        .first->second;
}

} // namespace ecir
