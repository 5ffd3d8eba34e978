#include "runtime/program.hpp"

#include <algorithm>

#include "runtime/compile_ahead.hpp"
#include "runtime/error.hpp"

// How a program becomes command buffers: barriers, submissions, timestamps.

namespace ecir {
namespace {

/// A submission ends after this much estimated work: desktop drivers give up on seconds-long ones.
constexpr double kSubmissionSeconds = 0.25;

double estimated_seconds(const Dispatch& dispatch, const DeviceInfo& device) {
    // Deliberately slow guesses, so that a submission stays short on weak devices as well.
    const bool fast = device.type == "discrete GPU";
    const double flops = fast ? 200e9 : 10e9;
    const double bytes = fast ? 50e9 : 5e9;
    return dispatch.flops / flops + dispatch.bytes / bytes + 5e-6;
}

void memory_barrier(VkCommandBuffer commands) {
    VkMemoryBarrier barrier{};
    barrier.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER;
    barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT |
                            VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT |
                            VK_ACCESS_INDIRECT_COMMAND_READ_BIT;
    constexpr auto kStages = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT |
                             VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT;
    vkCmdPipelineBarrier(commands, kStages, kStages, 0, 1, &barrier, 0, nullptr, 0, nullptr);
}

void host_barrier(VkCommandBuffer commands) {
    VkMemoryBarrier barrier{};
    barrier.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER;
    barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1,
                         &barrier, 0, nullptr, 0, nullptr);
}

} // namespace

void Program::record_step(VkCommandBuffer commands, const Memory& memory, size_t index) {
    const Step& step = steps_[index];
    if (step.clear) {
        const Range target = range(memory, step.dispatch.arguments.front());
        vkCmdFillBuffer(commands, target.buffer, target.begin, target.end - target.begin, 0);
        return;
    }
    const Dispatch& dispatch = step.dispatch;
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, dispatch.kernel->pipeline());
    if (memory.sets[index] != VK_NULL_HANDLE) {
        vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, dispatch.kernel->layout(),
                                0, 1, &memory.sets[index],
                                static_cast<uint32_t>(memory.dynamic[index].size()),
                                memory.dynamic[index].data());
    }
    std::vector<std::byte> push = dispatch.push;
    for (const auto& pointer : dispatch.pointers) {
        const uint64_t target = address(memory, pointer);
        std::memcpy(push.data() + pointer.push_offset, &target, sizeof(target));
    }
    if (!push.empty()) {
        vkCmdPushConstants(commands, dispatch.kernel->layout(), VK_SHADER_STAGE_COMPUTE_BIT, 0,
                           static_cast<uint32_t>(push.size()), push.data());
    }
    if (step.launch) {
        vkCmdDispatchIndirect(commands, memory.arena.handle(),
                              range(memory, ecir::read(*step.launch)).begin);
        return;
    }
    vkCmdDispatch(commands, dispatch.groups[0], dispatch.groups[1], dispatch.groups[2]);
}

Program::Recording Program::record(const Staging& staging, VkQueryPool queries) {
    VkCommandPoolCreateInfo pool_info{};
    pool_info.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
    pool_info.queueFamilyIndex = device_.queue_family();
    VkCommandPool pool = VK_NULL_HANDLE;
    vk_check(vkCreateCommandPool(device_.handle(), &pool_info, nullptr, &pool),
             "vkCreateCommandPool");
    Recording recording;
    recording.pool = Handle<VkCommandPool>(pool, device_.handle(), vkDestroyCommandPool);

    VkCommandBuffer commands = VK_NULL_HANDLE;
    double seconds = 0;
    const auto begin = [&] {
        VkCommandBufferAllocateInfo allocate{};
        allocate.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
        allocate.commandPool = pool;
        allocate.commandBufferCount = 1;
        vk_check(vkAllocateCommandBuffers(device_.handle(), &allocate, &commands),
                 "vkAllocateCommandBuffers");
        VkCommandBufferBeginInfo info{};
        info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
        vk_check(vkBeginCommandBuffer(commands, &info), "vkBeginCommandBuffer");
        recording.commands.push_back(commands);
        seconds = 0;
    };

    const Memory& memory = *staging.memory;
    begin();
    if (queries != VK_NULL_HANDLE) {
        vkCmdResetQueryPool(commands, queries, 0, static_cast<uint32_t>(steps_.size()) + 1);
    }
    memory_barrier(commands); // the run before this one may be under way, in the same arena
    barriers_ = 0;
    for (const Slot& slot : slots_) {
        if (slot.kind == Kind::input) {
            const VkBufferCopy copy{slot.staging_offset, slot.offset, slot.bytes};
            vkCmdCopyBuffer(commands, staging.upload.handle(), memory.arena.handle(), 1, &copy);
            barriers_ = 1;
        }
    }
    if (barriers_ > 0) {
        memory_barrier(commands);
    }
    if (queries != VK_NULL_HANDLE) {
        vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, queries, 0);
    }
    for (size_t index = 0; index < steps_.size(); ++index) {
        if (index > 0 && levels_[index] != levels_[index - 1]) {
            memory_barrier(commands);
            ++barriers_;
        }
        const double cost = estimated_seconds(steps_[index].dispatch, device_.info());
        if (seconds > 0 && seconds + cost > kSubmissionSeconds) {
            vk_check(vkEndCommandBuffer(commands), "vkEndCommandBuffer");
            begin();
        }
        seconds += cost;
        record_step(commands, memory, index);
        if (queries != VK_NULL_HANDLE) {
            vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, queries,
                                static_cast<uint32_t>(index) + 1);
        }
    }
    memory_barrier(commands);
    for (const Slot& slot : slots_) {
        if (slot.kind == Kind::output) {
            const VkBufferCopy copy{slot.offset, slot.staging_offset, slot.bytes};
            vkCmdCopyBuffer(commands, memory.arena.handle(), staging.readback.handle(), 1, &copy);
        }
    }
    host_barrier(commands);
    vk_check(vkEndCommandBuffer(commands), "vkEndCommandBuffer");
    return recording;
}

Program::~Program() {
    if (ahead_) {
        ahead_->end();
    }
    for (const size_t set : running_) {
        const VkFence fence = staging_[set].fence.get();
        (void)vkWaitForFences(device_.handle(), 1, &fence, VK_TRUE, UINT64_MAX);
    }
}

void Program::submit() {
    if (!reserve()) {
        throw Error(ExitCode::device, "program: submitted before a run under way was waited for");
    }
    const Staging& staging = staging_.at(written_);
    device_.start(staging.recording.commands, staging.fence.get(), staging.queue);
    running_.push_back(written_);
}

void Program::wait() {
    if (running_.empty()) {
        throw Error(ExitCode::device, "program: nothing was submitted to wait for");
    }
    read_ = running_.front();
    running_.erase(running_.begin());
    device_.wait(staging_[read_].fence.get());
    if (ahead_) {
        ahead_->end();
    }
}

void Program::run() {
    submit();
    wait();
}

std::vector<DispatchTime> Program::profile() {
    const uint64_t mask = device_.info().timestamp_mask;
    if (mask == 0) {
        throw Error(ExitCode::device, device_.info().name + " has no timestamps to profile with");
    }
    const auto count = static_cast<uint32_t>(steps_.size()) + 1;
    VkQueryPoolCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO;
    info.queryType = VK_QUERY_TYPE_TIMESTAMP;
    info.queryCount = count;
    VkQueryPool pool = VK_NULL_HANDLE;
    vk_check(vkCreateQueryPool(device_.handle(), &info, nullptr, &pool), "vkCreateQueryPool");
    const Handle<VkQueryPool> queries(pool, device_.handle(), vkDestroyQueryPool);
    const Recording timed = record(staging_.at(read_), pool);
    device_.submit(timed.commands, staging_.at(read_).queue);
    std::vector<uint64_t> ticks(count);
    vk_check(vkGetQueryPoolResults(device_.handle(), pool, 0, count, ticks.size() * 8, ticks.data(),
                                   8, VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
             "vkGetQueryPoolResults");
    std::vector<DispatchTime> times(steps_.size());
    for (size_t i = 0; i < steps_.size(); ++i) {
        const Dispatch& dispatch = steps_[i].dispatch;
        times[added_[i]] = {dispatch.label,
                            static_cast<double>((ticks[i + 1] - ticks[i]) & mask) *
                                device_.info().timestamp_ns * 1e-6,
                            dispatch.flops, dispatch.bytes};
    }
    return times;
}

} // namespace ecir
