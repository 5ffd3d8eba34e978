#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/operations.hpp"
#include "layers/prior.hpp"

namespace ecir::reference {

/// The blurry frame and the events of an exposure; the events' times are taken as float32.
struct PriorScene {
    uint32_t width;
    uint32_t height;
    std::span<const float> blurry;
    const PackedEvents& events;
    EdiThresholds thresholds;
};

/// What record_prior() computes, in double precision, each dense channels x height x width.
std::vector<double> prior_base(const PriorScene& scene);
std::vector<double> prior_anchors(const PriorScene& scene);
std::vector<double> prior_context(const PriorScene& scene);
std::vector<double> prior_logarithms(const PriorScene& scene);

/// What record_prior_frame() computes at a time; the other channels are 0.
std::vector<double> prior_frame(const PriorScene& scene, double time);

} // namespace ecir::reference

namespace ecir {

/// Cases of record_prior() and of record_prior_frame() (layers/prior.hpp).
Trial prior_trial(Device& device, uint32_t trial);
Trial prior_frame_trial(Device& device, uint32_t trial);

} // namespace ecir
