#include <doctest/doctest.h>

#include <set>
#include <utility>

#include "layers/deblur.hpp"
#include "layers/ecir.hpp"
#include "layers/fusion.hpp"
#include "layers/model_family.hpp"
#include "layers/operations.hpp"

namespace {

using namespace ecir;

constexpr uint32_t kHeight = 180;
constexpr uint32_t kWidth = 240;

/// The dispatches of convolutions by what they are called and how much they compute, which is alike
/// for one shape only.
using Convolutions = std::set<std::pair<std::string, double>>;

void add(Convolutions& convolutions, const std::vector<DispatchTime>& times) {
    for (const DispatchTime& time : times) {
        if (time.label.starts_with("conv") || time.label == "tap_sum") {
            convolutions.emplace(time.label, time.flops);
        }
    }
}

/// Of a network at 240x180 with 14 frames.
template <typename Method> void add_network(Convolutions& convolutions, Method&& method) {
    Events events;
    events.push_back(10, 1, 1, 1);
    const std::vector<float> blurry(size_t{kHeight} * kWidth, 0.5F);
    const auto times = even_times(14);
    method.frames({blurry, events.view(), {0, 1000}, times});
    add(convolutions, method.profile());
}

} // namespace

// The table that `ecir verify` and `ecir bench` run, as tests: every case of every operation
// against its reference.
TEST_SUITE("operations") {
    TEST_CASE("every kernel agrees with its double-precision reference") {
        const auto device = Device::open();
        for (const Operation& operation : operations()) {
            if (!runs_on(operation, device->info())) {
                continue;
            }
            for (uint32_t trial = 0; trial < operation.trials; ++trial) {
                const auto result = run_trial(operation, *device, trial);
                INFO(operation.name, " ", result.shape, ": error ", result.error);
                CHECK(result.ok);
            }
        }
    }

    TEST_CASE(
        "so it does at the networks' shapes, and these are the shapes of their convolutions") {
        const auto device = Device::open();
        Convolutions tried;
        for (const Operation& operation : operations()) {
            if (!runs_on(operation, device->info())) {
                continue;
            }
            for (uint32_t i = 0; i < operation.network_trials; ++i) {
                const Trial trial = operation.make(*device, operation.trials + i);
                const auto result = run_trial(operation, trial);
                INFO(operation.name, " ", trial.shape, ": error ", result.error);
                CHECK(result.ok);
                if (operation.name == "conv" || operation.name == "conv_row" ||
                    operation.name == "conv_pair") {
                    add(tried, trial.program->profile());
                }
            }
        }
        Convolutions run;
        const ModelFamily family = ModelFamily::shipped();
        for (const ModelFamily::Member& member : family.members()) {
            const SafeTensors weights(find_model(member.model));
            add_network(run, FusionMethod(device, weights, kHeight, kWidth));
        }
        add_network(run, EcirMethod(device, SafeTensors(find_model("ecir")), kHeight, kWidth, {}));
        for (const auto& [label, flops] : run) {
            INFO(label, " of ", flops, " operations, but layers/reference has no such case");
            CHECK(tried.contains({label, flops}));
        }
        for (const auto& [label, flops] : tried) {
            INFO(label, " of ", flops, " operations, which no shipped network runs");
            CHECK(run.contains({label, flops}));
        }
    }
}
