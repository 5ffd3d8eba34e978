#include "layers/reference/prior.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "layers/reference/edi.hpp"

namespace ecir::reference {
namespace {

constexpr double small = 0.01;
constexpr double longest_ramp = 0.05;
constexpr double largest = 2;
constexpr double dark = 0.05;
constexpr std::array<double, 2> decays = {0.04, 0.25};

/// One pixel: the times and the steps of its events.
struct Pixel {
    std::vector<double> times;
    std::vector<double> steps;

    Pixel(const PriorScene& scene, size_t index) {
        const uint32_t begin = scene.events.offset[index];
        const uint32_t end = scene.events.offset[index + 1];
        for (uint32_t i = begin; i < end && end - begin <= prior_busy_events; ++i) {
            times.push_back(scene.events.time[i]);
            steps.push_back(scene.events.mark[i] >> 31 != 0 ? double{scene.thresholds.positive}
                                                            : -double{scene.thresholds.negative});
        }
    }

    /// Events up to and including a time.
    [[nodiscard]] size_t until(double time) const {
        return static_cast<size_t>(std::ranges::upper_bound(times, time) - times.begin());
    }

    [[nodiscard]] double gap(size_t i) const { return times[i] - (i > 0 ? times[i - 1] : -1); }

    /// E(t), with ramps.
    [[nodiscard]] double level(double time) const {
        double sum = 0;
        for (size_t i = 0; i < times.size(); ++i) {
            const double width = std::max(std::min(gap(i), longest_ramp), 1e-9);
            const bool past = times[i] <= time;
            // A ramp starts after the event before, so only the next event's can have begun.
            sum += steps[i] * (past ? 1 : std::clamp((time - times[i]) / width + 1, 0.0, 1.0));
        }
        return sum;
    }

    /// ln of the mean of exp(E), a step in the middle of each ramp.
    [[nodiscard]] double log_mean() const {
        double sum = 0;
        double level = 0;
        double before = -1;
        for (size_t i = 0; i < times.size(); ++i) {
            const double middle = times[i] - 0.5 * std::min(gap(i), longest_ramp);
            sum += (middle - before) * std::exp(level);
            before = middle;
            level += steps[i];
        }
        sum += (1 - before) * std::exp(level);
        return std::log(sum / 2);
    }
};

double base(const PriorScene& scene, size_t index) {
    return std::log(double{scene.blurry[index]} + small) - Pixel(scene, index).log_mean();
}

double value(double logarithm) {
    return std::min(std::exp(std::min(logarithm, 2.0)) - small, largest);
}

size_t pixels(const PriorScene& scene) {
    return size_t{scene.width} * scene.height;
}

/// L at even times from -1 to 1, [count][pixels].
std::vector<double> even_frames(const PriorScene& scene, uint32_t count) {
    std::vector<double> result(count * pixels(scene));
    for (size_t p = 0; p < pixels(scene); ++p) {
        const Pixel pixel(scene, p);
        const double start = base(scene, p);
        for (uint32_t k = 0; k < count; ++k) {
            result[k * pixels(scene) + p] = value(start + pixel.level(2.0 * k / (count - 1) - 1));
        }
    }
    return result;
}

} // namespace

std::vector<double> prior_base(const PriorScene& scene) {
    std::vector<double> result;
    for (size_t p = 0; p < pixels(scene); ++p) {
        result.push_back(base(scene, p));
    }
    return result;
}

std::vector<double> prior_anchors(const PriorScene& scene) {
    return even_frames(scene, anchor_count);
}

std::vector<double> prior_context(const PriorScene& scene) {
    const size_t count = pixels(scene);
    std::vector<double> result(scene.blurry.begin(), scene.blurry.end());
    result.resize(anchor_count * count);
    for (size_t p = 0; p < count; ++p) {
        std::array<int, anchor_count> events{};
        for (const double time : Pixel(scene, p).times) {
            size_t anchor = 0;
            while (anchor + 2 < anchor_count &&
                   time >= -1 + 0.25 * static_cast<double>(anchor + 1)) {
                ++anchor;
            }
            ++events.at(anchor);
        }
        for (size_t a = 0; a + 1 < anchor_count; ++a) {
            result[(a + 1) * count + p] = 0.25 * std::log2(1.0 + std::min(events.at(a), 255));
        }
    }
    return result;
}

std::vector<double> prior_logarithms(const PriorScene& scene) {
    const auto frames = even_frames(scene, prior_windows + 1);
    const size_t width = (scene.width + 1) / 2;
    const size_t height = (scene.height + 1) / 2;
    std::vector<double> result;
    for (size_t k = 0; k <= prior_windows; ++k) {
        for (size_t i = 0; i < width * height; ++i) {
            double sum = 0;
            for (const size_t part : {0U, 1U, 2U, 3U}) {
                const size_t y = std::min<size_t>(i / width * 2 + part / 2, scene.height - 1);
                const size_t x = std::min<size_t>(i % width * 2 + part % 2, scene.width - 1);
                sum +=
                    std::log(std::max(frames[k * pixels(scene) + y * scene.width + x], 0.0) + dark);
            }
            result.push_back(sum / 4);
        }
    }
    return result;
}

std::vector<double> prior_frame(const PriorScene& scene, double time) {
    const size_t count = pixels(scene);
    std::vector<double> planes(plane_count * count);
    for (size_t p = 0; p < count; ++p) {
        const Pixel pixel(scene, p);
        const double now = value(base(scene, p) + pixel.level(time));
        planes[p] = now;
        planes[count + p] = scene.blurry[p];
        const size_t next = pixel.until(time);
        for (size_t i = 0; i < decays.size(); ++i) {
            if (next > 0) {
                planes[(11 + i) * count + p] =
                    (now + small) * pixel.steps[next - 1] *
                    std::exp((pixel.times[next - 1] - time) / decays.at(i));
            }
            if (next < pixel.times.size()) {
                planes[(13 + i) * count + p] = (now + small) * pixel.steps[next] *
                                               std::exp((time - pixel.times[next]) / decays.at(i));
            }
        }
        planes[15 * count + p] = time * time;
    }
    return planes;
}

} // namespace ecir::reference

namespace ecir {
namespace {

struct Case {
    uint32_t width = 1;
    uint32_t height = 1;
    uint32_t events = 0; ///< most of one pixel
    EdiThresholds thresholds;
    uint32_t block = 1; ///< of what the kernels write
    uint32_t halo = 0;
    bool rising = false; ///< every event is positive
};

/// The last one: 100,000 events and more, as `bench` gives to whole models.
constexpr std::array<Case, 11> cases = {{
    {16, 16, 12, {0.2F, 0.2F}, 1, 1},
    {17, 5, 0, {0.2F, 0.2F}, 1, 0},
    {1, 1, 9, {0.2F, 0.25F}, 8, 0},
    {65, 3, 14, {0.3F, 0.25F}, 8, 1},
    {34, 19, 40, {0.12F, 0.15F}, 1, 2},
    {131, 1, 40, {0.35F, 0.2F}, 16, 0},
    {31, 14, 7, {0.2F, 0.2F}, 4, 0},
    {2, 7, 900, {0.02F, 0.021F}, 1, 1}, // some with more than prior_busy_events
    {33, 46, 100, {0.1F, 0.11F}, 1, 0},
    {13, 11, 700, {0.35F, 0.35F}, 1, 0, true},
    {240, 180, 5, {0.2F, 0.2F}, 1, 1},
}};

/// The case's inputs, made and written by a program.
struct Inputs {
    PackedEvents events;
    std::vector<float> blurry;
    EdiThresholds thresholds;
    PriorInput tensors;

    Inputs(CaseRandom& random, const Case& shape, Program& program)
        : events(random_packed_events(random, size_t{shape.width} * shape.height, shape.events)),
          blurry(random.values(size_t{shape.width} * shape.height, 0, 1)),
          thresholds(shape.thresholds) {
        for (size_t i = 0; i < events.size() && shape.rising; ++i) {
            events.mark[i] |= uint32_t{1} << 31;
            events.positives[i + 1] = static_cast<uint32_t>(i + 1);
        }
        const auto count = std::max(1U, static_cast<uint32_t>(events.size()));
        tensors.offsets = program.input({1, 1, static_cast<uint32_t>(events.offset.size())});
        tensors.times = program.input({1, 1, count});
        tensors.marks = program.input({1, 1, count});
        tensors.positives = program.input({1, 1, count + 1});
        tensors.blurry = program.input({1, shape.height, shape.width, 1, shape.halo});
        tensors.thresholds = program.input({1, 1, 2});
    }
    void write(Program& program) const {
        program.write(tensors.offsets, events.offset);
        program.write(tensors.times, events.time);
        program.write(tensors.marks, events.mark);
        program.write(tensors.positives, events.positives);
        program.write(tensors.blurry, from_dense(tensors.blurry.layout(), blurry));
        program.write(tensors.thresholds,
                      std::vector<float>{thresholds.positive, thresholds.negative});
    }
};

std::string describe(const Case& shape) {
    return std::to_string(shape.width) + "x" + std::to_string(shape.height) + ", up to " +
           std::to_string(shape.events) + " events a pixel";
}

} // namespace

Trial prior_trial(Device& device, uint32_t trial) {
    constexpr std::array<const char*, 4> names = {" anchors", " context", " base", " logarithms"};
    const size_t which = trial % names.size(); // of the outputs is compared
    const Case& shape = cases.at(trial / names.size());
    CaseRandom random(700 + trial);
    Trial result;
    result.shape = describe(shape) + names.at(which);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Inputs inputs(random, shape, program);
    const std::array<Layout, 4> layouts = {
        Layout{anchor_count, shape.height, shape.width, shape.block, shape.halo},
        Layout{anchor_count, shape.height, shape.width, shape.block, shape.halo},
        Layout{1, shape.height, shape.width, shape.block, shape.halo},
        Layout{prior_windows + 1, (shape.height + 1) / 2, (shape.width + 1) / 2, shape.block,
               shape.halo}};
    std::array<Tensor, 4> outputs;
    for (size_t i = 0; i < outputs.size(); ++i) {
        outputs.at(i) =
            i == which ? program.output(layouts.at(i)) : program.temporary(layouts.at(i));
        program.clear(outputs.at(i));
    }
    result.first_step = program.steps();
    record_prior(program, inputs.tensors, {outputs[0], outputs[1], outputs[2], outputs[3]});
    program.finish();
    inputs.write(program);
    result.output = outputs.at(which);
    const reference::PriorScene scene{shape.width, shape.height, inputs.blurry, inputs.events,
                                      inputs.thresholds};
    constexpr std::array references = {reference::prior_anchors, reference::prior_context,
                                       reference::prior_base, reference::prior_logarithms};
    result.reference = references.at(which)(scene);
    return result;
}

Trial prior_frame_trial(Device& device, uint32_t trial) {
    const Case& shape = cases.at(trial);
    CaseRandom random(800 + trial);
    Trial result;
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Inputs inputs(random, shape, program);
    auto time = double{static_cast<float>(random.uniform(-1, 1))};
    if (trial % 3 == 0 && inputs.events.size() > 0) { // at an event's very time
        time = inputs.events.time[inputs.events.size() / 2];
    } else if (trial % 3 == 1) {
        time = trial % 2 == 0 ? 1 : -1;
    }
    result.shape = describe(shape) + " at " + std::to_string(time);
    const Tensor instants = program.input(instant_layout(2));
    PriorExposure exposure;
    exposure.anchors = program.temporary({anchor_count, shape.height, shape.width});
    exposure.context = program.temporary(exposure.anchors.layout());
    exposure.base = program.temporary({1, shape.height, shape.width, 1, shape.halo});
    exposure.logarithms =
        program.temporary({prior_windows + 1, (shape.height + 1) / 2, (shape.width + 1) / 2});
    record_prior(program, inputs.tensors, exposure);
    result.output =
        program.output({plane_count, shape.height, shape.width, shape.block, shape.halo});
    program.clear(result.output);
    result.first_step = program.steps();
    const Tensor state = program.temporary(prior_state_layout(shape.height, shape.width));
    program.clear(state);
    // There and back: the first of the two frames leaves a state behind.
    for (const uint32_t i : {0U, 1U}) {
        record_prior_frame(program, inputs.tensors, exposure.base, instants.channels(i, 1), state,
                           result.output);
    }
    program.finish();
    inputs.write(program);
    const std::vector<Instant> both = {Instant(0.5), Instant(time)};
    program.write(instants, std::as_bytes(std::span(both)));
    result.reference = reference::prior_frame(
        {shape.width, shape.height, inputs.blurry, inputs.events, inputs.thresholds}, time);
    return result;
}

} // namespace ecir
