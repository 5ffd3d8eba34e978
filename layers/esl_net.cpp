#include "layers/esl_net.hpp"

#include <algorithm>
#include <array>
#include <functional>
#include <iterator>

#include "layers/elementwise.hpp"
#include "layers/operations.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

constexpr uint32_t kChannels = 2 * EslNet::bins; ///< of images and event counts
constexpr uint32_t kCodes = 128;                 ///< channels of the sparse code
constexpr uint32_t kRounds = 25;
/// Channels that a convolution binds on a CPU driver: at 1280x720 113 MiB, where lavapipe's limit
/// is 128 MiB. GPUs, which bind far more, bind the whole code: 452 MiB at 1280x720.
constexpr uint32_t kMostBound = 32;

const std::vector<float>& weight_of(const SafeTensors& weights, const std::string& name,
                                    uint32_t in, uint32_t out, uint32_t kernel) {
    return weights.get("esl." + name + ".weight", {out, in, kernel, kernel});
}

Conv load(Device& device, const SafeTensors& weights, const std::string& name, uint32_t in,
          uint32_t out, uint32_t kernel, ConvFamily family) {
    return {device,
            {.out_channels = out, .kernel = kernel, .most_bound = kMostBound},
            {channel_range(0, in)},
            weight_of(weights, name, in, out, kernel),
            {},
            family};
}

/// S2 negated, with the ReLU that follows it.
Conv load_subtraction(Device& device, const SafeTensors& weights, const std::string& name,
                      ConvFamily family) {
    std::vector<float> weight = weight_of(weights, name, kChannels, kCodes, 3);
    std::ranges::transform(weight, weight.begin(), std::negate{});
    return {device,
            {.out_channels = kCodes, .kernel = 3, .relu = true, .most_bound = kMostBound},
            {channel_range(0, kChannels)},
            weight,
            {},
            family};
}

/// The first event layer on the two polarities of outward_intervals(). The network counts the
/// events of one distance on both sides together, those before the instant with their sign turned
/// round; here each side keeps its own channels and finds the common weights.
Conv load_counts(Device& device, const SafeTensors& weights, const std::string& name,
                 ConvFamily family) {
    const auto& published = weight_of(weights, name, kChannels, kChannels, 1);
    std::vector<float> weight;
    for (uint32_t out = 0; out < kChannels; ++out) {
        const auto row = published.begin() + std::ptrdiff_t{out} * kChannels;
        // Before the instant, farthest first: positives 2k + 1, the others 2k. Then after it.
        weight.insert(weight.end(), std::make_reverse_iterator(row + kChannels),
                      std::make_reverse_iterator(row));
        weight.insert(weight.end(), row, row + kChannels);
    }
    return {device,
            {.out_channels = kChannels, .kernel = 1, .most_bound = kMostBound},
            {channel_range(0, 2 * kChannels)},
            weight,
            {},
            family};
}

} // namespace

ConvFamily EslNet::family(const DeviceInfo& info, uint32_t height, uint32_t width) {
    constexpr std::array channels = {kChannels, kCodes};
    return row_family(info, channels,
                      conv_layout(info, ConvFamily::row, kCodes, height, width, 1).elements());
}

EslNet::EslNet(Device& device, const SafeTensors& weights, ConvFamily family)
    : family_(family), image_d_(load(device, weights, "image_d", 1, kChannels, 1, family)),
      event_c1_(load_counts(device, weights, "event_c1", family)),
      event_c2_(load(device, weights, "event_c2", kChannels, kChannels, 1, family)),
      w1_(load(device, weights, "scn.0.W1", kChannels, kCodes, 3, family)),
      s1_(load(device, weights, "scn.0.S1", kCodes, kChannels, 3, family)),
      s2_(load_subtraction(device, weights, "scn.0.S2", family)),
      w2_(load(device, weights, "W2", kCodes, kChannels, 3, family)),
      endconv_(device, kChannels, 3, weight_of(weights, "endconv", kChannels, 1, 3), 0, family) {}

void EslNet::record(Program& program, const Tensor& blurry, const Tensor& histogram,
                    const Tensor& output) const {
    const Layout& size = blurry.layout();
    const DeviceInfo& info = program.device().info();
    // Cleared where a convolution reads the zeros around its input.
    const auto tensor = [&](uint32_t channels, uint32_t halo) {
        const Layout layout = conv_layout(info, family_, channels, size.height, size.width, halo);
        return halo > 0 ? program.cleared(layout) : program.temporary(layout);
    };
    const Tensor hidden = tensor(kChannels, 0);
    const Tensor gate = tensor(kChannels, 0);
    event_c1_.record(program, histogram, hidden);
    record_sigmoid(program, hidden, hidden);
    event_c2_.record(program, hidden, gate);
    record_sigmoid(program, gate, gate);

    const Tensor image = tensor(kChannels, 0);
    const Tensor gated = tensor(kChannels, 1);
    image_d_.record(program, blurry, image);
    record_multiply(program, image, gate, gated);
    record_multiply(program, gate, gate, gate); // the rounds gate twice

    const Tensor start = tensor(kCodes, 0);
    const Tensor code = tensor(kCodes, 1);
    w1_.record(program, gated, start);
    record_add(program, code, start, code, true); // the code is 0 so far
    for (uint32_t round = 0; round < kRounds; ++round) {
        s1_.record(program, code, image);
        record_multiply(program, image, gate, gated);
        record_add(program, code, start, code);
        s2_.record(program, gated, code, code);
    }
    w2_.record(program, code, image);
    endconv_.record(program, image, output);
}

EslNetMethod::EslNetMethod(const std::shared_ptr<Device>& device, const SafeTensors& weights,
                           uint32_t height, uint32_t width)
    : EslNetMethod(device,
                   std::make_shared<const EslNet>(*device, weights,
                                                  EslNet::family(device->info(), height, width)),
                   height, width) {}

EslNetMethod::EslNetMethod(std::shared_ptr<Device> device, std::shared_ptr<const EslNet> network,
                           uint32_t height, uint32_t width)
    : device_(std::move(device)), network_(std::move(network)), height_(height), width_(width) {}

std::unique_ptr<Method> EslNetMethod::resized(uint32_t height, uint32_t width) const {
    return std::unique_ptr<Method>(new EslNetMethod(device_, network_, height, width));
}

void EslNetMethod::record(Program& program, uint32_t capacity) {
    events_ = EventTensors(program, height_, width_, capacity);
    const DeviceInfo& info = device_->info();
    blurry_ = program.input(network_->blurry_layout(info, height_, width_));
    intervals_ = program.input({1, 1, 4 * EslNet::bins});
    output_ = program.output({1, height_, width_});
    const Tensor histogram = program.temporary(network_->histogram_layout(info, height_, width_));
    record_event_histogram(program, events_.offset, events_.mark, events_.positives, intervals_,
                           histogram);
    network_->record(program, blurry_, histogram, output_);
}

void EslNetMethod::begin(const FrameInput& input) {
    Program& program =
        program_.prepare(*device_, 1, input.events.size(),
                         [&](Program& made, uint32_t capacity) { record(made, capacity); });
    events_.write(program, pack_events(input.events, input.exposure, width_, height_));
    program.write(blurry_, from_dense(blurry_.layout(), input.blurry));
    std::vector<float> frames;
    for (const double time : input.times) {
        const auto ranges = outward_intervals(input.events, input.exposure, time, EslNet::bins);
        program.write(intervals_, std::as_bytes(std::span(ranges)));
        program.run();
        const auto frame = program.read(output_);
        frames.insert(frames.end(), frame.begin(), frame.end());
    }
    made_.push_back(std::move(frames));
}

std::span<const float> EslNetMethod::finish() {
    finished_ = std::move(made_.at(0));
    made_.erase(made_.begin());
    return finished_;
}

} // namespace ecir
