#include "runtime/program.hpp"

#include <algorithm>
#include <numeric>

#include "runtime/compile_ahead.hpp"
#include "runtime/error.hpp"

namespace ecir {
namespace {

/// Kernels may read (never write) a little past a tensor's last row; so the arena ends later.
constexpr uint64_t kArenaSlack = 64 << 10;

uint64_t align(uint64_t value) {
    return (value + kBindingAlignment - 1) / kBindingAlignment * kBindingAlignment;
}

constexpr size_t kMostLaunches = 8;

/// Mirrors the push constants of shaders/launch.comp.
struct LaunchPush {
    uint32_t flag = 0;
    uint32_t words = 0;
    std::array<uint32_t, 3 * kMostLaunches> wanted{};
};
static_assert(sizeof(LaunchPush) == 104);

} // namespace

Program::Program(Device& device) : device_(device) {}

Tensor Program::make(Kind kind, const Layout& layout) {
    const Tensor tensor(static_cast<uint32_t>(slots_.size()), layout);
    const DeviceInfo& info = device_.info();
    if (tensor.bytes() > info.heap_bytes) { // before the recording of work that could never run
        throw Error(ExitCode::resources, "one tensor of this needs " + mebibytes(tensor.bytes()) +
                                             " of device memory, but " + info.name + " has " +
                                             mebibytes(info.heap_bytes) +
                                             "; use a smaller --size or fewer --frames, or another "
                                             "device (-g)");
    }
    slots_.push_back({kind, tensor.bytes()});
    return tensor;
}

Tensor Program::input(const Layout& layout) {
    return make(Kind::input, layout);
}
Tensor Program::output(const Layout& layout) {
    return make(Kind::output, layout);
}
Tensor Program::temporary(const Layout& layout) {
    return make(Kind::temporary, layout);
}

Tensor Program::cleared(const Layout& layout) {
    const Tensor tensor = temporary(layout);
    clear(tensor);
    return tensor;
}

void Program::add(Dispatch dispatch) {
    for (size_t axis = 0; axis < dispatch.groups.size(); ++axis) {
        const uint32_t most = device_.info().max_groups.at(axis);
        if (dispatch.groups.at(axis) > most) {
            throw Error(ExitCode::resources, "kernel " + dispatch.kernel->name() + " needs " +
                                                 std::to_string(dispatch.groups.at(axis)) +
                                                 " workgroups along one axis, but " +
                                                 device_.info().name + " launches at most " +
                                                 std::to_string(most) + "; use a smaller --size");
        }
    }
    steps_.push_back({std::move(dispatch)});
}

void Program::clear(const Tensor& tensor) {
    if (conditional_) {
        throw Error(ExitCode::device, "program: a clear cannot be left out");
    }
    Dispatch fill;
    fill.arguments = {ecir::write(tensor)};
    fill.bytes = static_cast<double>(tensor.bytes());
    fill.label = "clear";
    steps_.push_back({std::move(fill), true});
}

void Program::when(const Tensor& flag, const std::function<void()>& record) {
    if (conditional_) {
        throw Error(ExitCode::device, "program: a condition inside of another");
    }
    const size_t begin = steps_.size();
    conditional_ = true;
    record();
    conditional_ = false;

    std::vector<std::array<uint32_t, 3>> wanted; // of all these dispatches, each once
    std::vector<size_t> place;
    for (size_t index = begin; index < steps_.size(); ++index) {
        const auto& groups = steps_[index].dispatch.groups;
        const auto known = std::ranges::find(wanted, groups);
        place.push_back(static_cast<size_t>(known - wanted.begin()));
        if (known == wanted.end()) {
            wanted.push_back(groups);
        }
    }
    std::vector<Tensor> counts;
    std::vector<Step> launches;
    for (size_t first = 0; first < wanted.size(); first += kMostLaunches) {
        const size_t some = std::min(kMostLaunches, wanted.size() - first);
        const Tensor made = temporary({static_cast<uint32_t>(some), 1, 3});
        LaunchPush push;
        push.flag = PushLayout(flag).origin;
        push.words = static_cast<uint32_t>(3 * some);
        for (size_t i = 0; i < some; ++i) {
            std::ranges::copy(wanted[first + i], push.wanted.begin() + 3 * i);
            counts.push_back(made.channels(static_cast<uint32_t>(i), 1));
        }
        Dispatch launch;
        launch.kernel = &device_.kernel("launch", {}, 2, sizeof(push));
        launch.arguments = {ecir::read(flag), ecir::write(made)};
        launch.set_push(push);
        launch.label = "launch";
        launches.push_back({std::move(launch)});
    }
    for (size_t i = 0; i < place.size(); ++i) {
        steps_[begin + i].launch = counts[place[i]];
    }
    steps_.insert(steps_.begin() + static_cast<std::ptrdiff_t>(begin), launches.begin(),
                  launches.end());
}

void Program::plan() {
    for (size_t step = 0; step < steps_.size(); ++step) {
        for (const Argument& argument : tensors(steps_[step])) {
            Slot& slot = slots_.at(argument.tensor.id());
            slot.first = std::min(slot.first, levels_[step]);
            slot.last = std::max(slot.last, levels_[step]);
        }
    }
    std::vector<Lifetime> lifetimes;
    const uint32_t end = levels_.empty() ? 0 : levels_.back() + 1;
    for (Slot& slot : slots_) {
        if (slot.kind == Kind::input) {
            slot.first = 0; // uploads happen before the first level
            slot.staging_offset = upload_bytes_;
            upload_bytes_ += align(slot.bytes);
        }
        if (slot.kind == Kind::output) {
            slot.last = end; // downloads happen after the last
            slot.staging_offset = readback_bytes_;
            readback_bytes_ += align(slot.bytes);
        }
        slot.first = std::min(slot.first, end);
        lifetimes.push_back({align(slot.bytes), slot.first, slot.last});
    }
    const ArenaPlan planned = plan_arena(lifetimes, kBindingAlignment);
    for (size_t i = 0; i < slots_.size(); ++i) {
        slots_[i].offset = planned.offsets[i];
    }
    arena_bytes_ = planned.bytes + kArenaSlack;

    const DeviceInfo& info = device_.info();
    const uint64_t wanted = arena_bytes_ + upload_bytes_ + readback_bytes_;
    if (wanted > info.heap_bytes) {
        throw Error(ExitCode::resources,
                    "this needs " + mebibytes(wanted) + " of device memory, but " + info.name +
                        " has " + mebibytes(info.heap_bytes) +
                        "; use a smaller --size or fewer --frames, or another device (-g)");
    }
}

void Program::compile_ahead() {
    std::vector<const Kernel*> fresh;
    for (const Step& step : steps_) {
        const Kernel* kernel = step.dispatch.kernel;
        if (kernel != nullptr && kernel->fresh() &&
            std::ranges::find(fresh, kernel) == fresh.end()) {
            fresh.push_back(kernel);
        }
    }
    if (device_.info().is_cpu && fresh.size() >= kManyFreshKernels) {
        std::ranges::for_each(fresh, &Kernel::compiles_ahead);
        ahead_ = std::make_unique<CompileAhead>(device_, fresh);
    }
}

void Program::finish() {
    order();
    plan();
    compile_ahead();
    staging_.push_back(make_staging(make_memory(), 0));
}

Program::Staging Program::make_staging(std::shared_ptr<const Memory> memory, uint32_t queue) {
    Staging staging;
    staging.memory = std::move(memory);
    staging.queue = queue;
    staging.upload = Buffer(device_, std::max<uint64_t>(upload_bytes_, 4), Buffer::Place::upload);
    staging.readback =
        Buffer(device_, std::max<uint64_t>(readback_bytes_, 4), Buffer::Place::readback);
    staging.recording = record(staging, VK_NULL_HANDLE);
    staging.fence = device_.make_fence();
    return staging;
}

bool Program::reserve() {
    const auto free = [&](size_t set) {
        return std::ranges::find(running_, set) == running_.end();
    };
    if (free(written_)) {
        return true;
    }
    for (size_t set = 0; set < staging_.size(); ++set) {
        if (free(set)) {
            written_ = set;
            return true;
        }
    }
    return staging_.size() < kMostStaging && (add_staging(true) || add_staging(false));
}

bool Program::add_staging(bool apart) {
    const uint64_t staging = (staging_.size() + 1) * (upload_bytes_ + readback_bytes_);
    const uint64_t heap = device_.info().heap_bytes;
    // A second arena may take no more of the memory than leaves as much for others.
    if (apart ? device_.queues() < 2 || 2 * arena_bytes_ + staging > heap / 2
              : arena_bytes_ + staging > heap) {
        return false;
    }
    try {
        staging_.push_back(apart ? make_staging(make_memory(), 1)
                                 : make_staging(staging_.front().memory, 0));
    } catch (const Error& error) {
        if (error.code() == ExitCode::resources) {
            return false; // it works without
        }
        throw;
    }
    written_ = staging_.size() - 1;
    return true;
}

double Program::flops() const {
    return std::accumulate(steps_.begin(), steps_.end(), 0.0,
                           [](double sum, const Step& step) { return sum + step.dispatch.flops; });
}

void Program::write(const Tensor& input, std::span<const std::byte> data) {
    const Slot& slot = slots_.at(input.id());
    if (slot.kind != Kind::input || data.size() > slot.bytes) {
        throw Error(ExitCode::device, "program: " + std::to_string(data.size()) +
                                          " bytes written to a tensor of " +
                                          std::to_string(slot.bytes));
    }
    if (!reserve()) {
        throw Error(ExitCode::device, "program: written to before a run under way was waited for");
    }
    std::ranges::copy(data, staging_.at(written_).upload.mapped() + slot.staging_offset);
}

std::span<const float> Program::read(const Tensor& output) const {
    const Slot& slot = slots_.at(output.id());
    if (slot.kind != Kind::output) {
        throw Error(ExitCode::device, "program: only outputs can be read");
    }
    const auto* values =
        reinterpret_cast<const float*>(staging_.at(read_).readback.mapped() + slot.staging_offset);
    return {values, slot.bytes / 4};
}

} // namespace ecir
