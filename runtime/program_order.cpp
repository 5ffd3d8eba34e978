#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

#include "runtime/program.hpp"

// When a program's steps run: in levels, so that few barriers stand between them.

namespace ecir {
namespace {

/// A part of a tensor's memory that a step reads or writes, as a kernel's binding has it.
struct Touch {
    uint64_t begin;
    uint64_t end;
    size_t step;
};

/// What earlier steps did to a tensor.
struct History {
    std::vector<Touch> reads;
    std::vector<Touch> writes;

    /// Those that `mine` has to wait for.
    template <typename Action>
    void each_conflict(const Touch& mine, bool writing, const Action& action) const {
        for (const std::vector<Touch>* touches : {&writes, &reads}) {
            if (touches == &reads && !writing) {
                continue;
            }
            for (const Touch& other : *touches) {
                if (other.step != mine.step && mine.begin < other.end && other.begin < mine.end) {
                    action(other.step);
                }
            }
        }
    }
    void add(const Touch& mine, bool writing) {
        if (!writing) {
            reads.push_back(mine);
            return;
        }
        // Who would wait for these waits for this one, which does.
        const auto covered = [&](const Touch& other) {
            return mine.begin <= other.begin && other.end <= mine.end;
        };
        std::erase_if(reads, covered);
        std::erase_if(writes, covered);
        writes.push_back(mine);
    }
};

} // namespace

std::vector<Argument> Program::tensors(const Step& step) {
    std::vector<Argument> result;
    const auto collect = [&](const Argument& argument) {
        if (argument.buffer == nullptr) { // buffers outside the arena are only ever read
            result.push_back(argument);
        }
    };
    std::ranges::for_each(step.dispatch.arguments, collect);
    for (const Dispatch::Pointer& pointer : step.dispatch.pointers) {
        collect(pointer.argument);
    }
    if (step.launch) {
        collect(ecir::read(*step.launch));
    }
    return result;
}

void Program::order() {
    std::vector<History> histories(slots_.size());
    std::vector<uint32_t> level(steps_.size(), 0);
    // Zeros wait until just before somebody needs them, since they take memory from then on.
    std::vector<uint32_t> needed(steps_.size(), UINT32_MAX);
    for (size_t step = 0; step < steps_.size(); ++step) {
        const std::vector<Argument> touched = tensors(steps_[step]);
        const auto each = [&](const auto& action) {
            for (const Argument& argument : touched) {
                const uint64_t begin = argument.tensor.byte_offset();
                action(histories[argument.tensor.id()],
                       Touch{begin / kBindingAlignment * kBindingAlignment,
                             begin + argument.tensor.bytes(), step},
                       argument.access != Access::read);
            }
        };
        each([&](const History& history, const Touch& mine, bool writing) {
            history.each_conflict(mine, writing, [&](size_t other) {
                level[step] = std::max(level[step], level[other] + 1);
            });
        });
        each([&](const History& history, const Touch& mine, bool writing) {
            history.each_conflict(mine, writing, [&](size_t other) {
                needed[other] = std::min(needed[other], level[step]);
            });
        });
        each([](History& history, const Touch& mine, bool writing) { history.add(mine, writing); });
    }
    for (size_t step = 0; step < steps_.size(); ++step) {
        if (steps_[step].clear && needed[step] != UINT32_MAX) {
            level[step] = needed[step] - 1;
        }
    }

    added_.resize(steps_.size());
    std::iota(added_.begin(), added_.end(), size_t{0});
    std::ranges::stable_sort(added_, {}, [&](size_t step) { return level[step]; });
    std::vector<Step> ordered;
    for (const size_t step : added_) {
        ordered.push_back(std::move(steps_[step]));
        levels_.push_back(level[step]);
    }
    steps_ = std::move(ordered);
}

} // namespace ecir
