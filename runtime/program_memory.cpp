#include <algorithm>
#include <map>

#include "runtime/error.hpp"
#include "runtime/program.hpp"

// What the steps of a program work on: an arena, and descriptors of its parts.

namespace ecir {
namespace {

/// A descriptor set to make.
struct Wanted {
    const Kernel* kernel;
    std::vector<VkDescriptorBufferInfo> buffers;
};

Handle<VkDescriptorPool> make_pool(const Device& device, const std::vector<Wanted>& sets) {
    uint32_t storage = 1;
    uint32_t uniform = 1;
    for (const Wanted& set : sets) {
        for (const auto& binding : set.kernel->reflection().bindings) {
            (binding.uniform ? uniform : storage) += 1;
        }
    }
    const std::array<VkDescriptorPoolSize, 2> sizes = {
        VkDescriptorPoolSize{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, storage},
        VkDescriptorPoolSize{VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER_DYNAMIC, uniform}};
    VkDescriptorPoolCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO;
    info.maxSets = static_cast<uint32_t>(std::max<size_t>(sets.size(), 1));
    info.poolSizeCount = static_cast<uint32_t>(sizes.size());
    info.pPoolSizes = sizes.data();
    VkDescriptorPool pool = VK_NULL_HANDLE;
    vk_check(vkCreateDescriptorPool(device.handle(), &info, nullptr, &pool),
             "vkCreateDescriptorPool");
    return {pool, device.handle(), vkDestroyDescriptorPool};
}

VkDescriptorSet make_set(const Device& device, VkDescriptorPool pool, const Wanted& set) {
    VkDescriptorSetAllocateInfo allocate{};
    allocate.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO;
    allocate.descriptorPool = pool;
    allocate.descriptorSetCount = 1;
    const VkDescriptorSetLayout layout = set.kernel->set_layout();
    allocate.pSetLayouts = &layout;
    VkDescriptorSet handle = VK_NULL_HANDLE;
    vk_check(vkAllocateDescriptorSets(device.handle(), &allocate, &handle),
             "vkAllocateDescriptorSets");
    std::vector<VkWriteDescriptorSet> writes;
    for (uint32_t i = 0; i < set.buffers.size(); ++i) {
        VkWriteDescriptorSet one{};
        one.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
        one.dstSet = handle;
        one.dstBinding = i;
        one.descriptorCount = 1;
        one.descriptorType = set.kernel->reflection().bindings[i].uniform
                                 ? VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER_DYNAMIC
                                 : VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
        one.pBufferInfo = &set.buffers[i];
        writes.push_back(one);
    }
    vkUpdateDescriptorSets(device.handle(), static_cast<uint32_t>(writes.size()), writes.data(), 0,
                           nullptr);
    return handle;
}

} // namespace

Program::Range Program::range(const Memory& memory, const Argument& argument) const {
    if (argument.buffer != nullptr) {
        return {argument.buffer->handle(), argument.offset, argument.buffer->size()};
    }
    const Tensor& tensor = argument.tensor;
    const uint64_t begin = slots_[tensor.id()].offset + tensor.byte_offset();
    return {memory.arena.handle(), begin, begin + tensor.bytes()};
}

uint64_t Program::address(const Memory& memory, const Dispatch::Pointer& pointer) const {
    const Buffer* outside = pointer.argument.buffer.get();
    const uint64_t base = outside != nullptr ? outside->address() : memory.arena.address();
    return base + range(memory, pointer.argument).begin + pointer.byte_offset;
}

std::shared_ptr<const Program::Memory> Program::make_memory() const {
    auto memory = std::make_shared<Memory>();
    memory->arena = Buffer(device_, arena_bytes_, Buffer::Place::device);
    memory->dynamic.resize(steps_.size());
    const DeviceInfo& info = device_.info();
    std::vector<Wanted> wanted;
    std::map<std::vector<uint64_t>, size_t> known;
    std::vector<size_t> set_of_step(steps_.size(), SIZE_MAX);
    for (size_t index = 0; index < steps_.size(); ++index) {
        const Dispatch& dispatch = steps_[index].dispatch;
        if (steps_[index].clear || dispatch.arguments.empty()) {
            continue;
        }
        const auto& bindings = dispatch.kernel->reflection().bindings;
        Wanted set{dispatch.kernel, {}};
        std::vector<uint64_t> key{reinterpret_cast<uint64_t>(dispatch.kernel)};
        for (size_t i = 0; i < bindings.size(); ++i) {
            const Argument& argument = dispatch.arguments.at(i);
            Range bound = range(*memory, argument);
            if (bindings[i].uniform) {
                memory->dynamic[index].push_back(static_cast<uint32_t>(argument.offset));
                bound.begin = 0;
                bound.end = std::min<uint64_t>(argument.buffer->size(), info.max_uniform_range);
            } else {
                bound.begin = bound.begin / kBindingAlignment * kBindingAlignment;
                if (bound.end - bound.begin > info.max_storage_range) {
                    throw Error(ExitCode::resources,
                                "kernel " + dispatch.kernel->name() + " binds a tensor of " +
                                    mebibytes(bound.end - bound.begin) + ", but " + info.name +
                                    " binds at most " + mebibytes(info.max_storage_range) +
                                    "; use a smaller --size or fewer --frames");
                }
            }
            set.buffers.push_back({bound.buffer, bound.begin, bound.end - bound.begin});
            key.insert(key.end(),
                       {reinterpret_cast<uint64_t>(bound.buffer), bound.begin, bound.end});
        }
        const auto [found, fresh] = known.try_emplace(std::move(key), wanted.size());
        set_of_step[index] = found->second;
        if (fresh) {
            wanted.push_back(std::move(set));
        }
    }

    memory->pool = make_pool(device_, wanted);
    std::vector<VkDescriptorSet> made;
    made.reserve(wanted.size());
    for (const Wanted& set : wanted) {
        made.push_back(make_set(device_, memory->pool.get(), set));
    }
    memory->sets.assign(steps_.size(), VK_NULL_HANDLE);
    for (size_t index = 0; index < steps_.size(); ++index) {
        if (set_of_step[index] != SIZE_MAX) {
            memory->sets[index] = made[set_of_step[index]];
        }
    }
    return memory;
}

} // namespace ecir
