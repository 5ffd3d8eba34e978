#include "layers/keypoints.hpp"

#include <algorithm>
#include <string>

#include "layers/pixel_dispatch.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/keypoints.comp.
struct Push {
    PushLayout keypoints;
    uint32_t width;
    uint32_t height;
    uint32_t first; ///< channel of keypoint 0
    uint32_t n;
    uint32_t filled; ///< channels first + n, ..., filled - 1 become 0
    std::array<float, max_keypoints> pivots;
};
static_assert(sizeof(Push) == 116);

void check_count(uint32_t n) {
    if (n < min_keypoints || n > max_keypoints) {
        throw Error(ExitCode::bad_input,
                    std::to_string(n) + " keypoints: " + std::to_string(min_keypoints) + " to " +
                        std::to_string(max_keypoints) + " are supported");
    }
}

} // namespace

KeypointRule paper_keypoint_rule(const PackedEvents& events, uint32_t n) {
    check_count(n);
    const auto span = static_cast<uint32_t>(events.duration);
    return {2 * (n - 1), 0, span, span};
}

KeypointRule release_keypoint_rule(const PackedEvents& events, uint32_t n) {
    check_count(n);
    if (events.tick.empty()) {
        return {};
    }
    const auto [first, last] = std::ranges::minmax(events.tick);
    const auto span = static_cast<uint32_t>(last - first);
    return {n - 1, static_cast<uint32_t>(first), n * span, span};
}

std::array<float, max_keypoints> keypoint_pivots(uint32_t n) {
    check_count(n);
    std::array<float, max_keypoints> pivots{};
    for (uint32_t i = 0; i < n; ++i) {
        pivots[i] = static_cast<float>((2.0 * i - (n - 1.0)) / (n - 1.0));
    }
    return pivots;
}

void record_keypoints(Program& program, const Tensor& offsets, const Tensor& times,
                      const Tensor& ticks, const Tensor& rule, const Tensor& keypoints,
                      uint32_t first_channel, uint32_t n) {
    const Layout& layout = keypoints.layout();
    const uint32_t end = first_channel + n;
    const auto pivots = keypoint_pivots(n);
    if (end > layout.channels || offsets.layout().width != layout.width * layout.height + 1) {
        throw Error(ExitCode::bad_input,
                    "keypoints: channels " + std::to_string(first_channel) + " to " +
                        std::to_string(end - 1) + " and " + std::to_string(offsets.layout().width) +
                        " pixel offsets do not fit " + std::to_string(layout.channels) + "x" +
                        std::to_string(layout.height) + "x" + std::to_string(layout.width));
    }
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("keypoints", {}, 5, sizeof(Push));
    // update: the other channels of the tensor stay as they are.
    dispatch.arguments = {read(offsets), read(times), read(ticks), read(rule), update(keypoints)};
    dispatch.set_push(Push{PushLayout(keypoints), layout.width, layout.height, first_channel, n,
                           end == layout.channels ? padded_channels(layout) : end, pivots});
    dispatch.groups = pixel_groups(layout);
    dispatch.bytes = 4.0 * n * layout.width * layout.height +
                     static_cast<double>(offsets.bytes() + times.bytes() + ticks.bytes());
    dispatch.label = "keypoints";
    program.add(std::move(dispatch));
}

} // namespace ecir
