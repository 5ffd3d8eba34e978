#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/edi.hpp"
#include "layers/event_pack.hpp"
#include "layers/operations.hpp"

namespace ecir::reference {

/// ln(L(t) + e) of the event-based double integral (see layers/edi.hpp) in double precision, the
/// events' times taken as float32. blurry: one value a pixel of `events`. Returns [times][pixels].
std::vector<double> edi_logarithm(std::span<const float> blurry, const PackedEvents& events,
                                  std::span<const double> times, const EdiThresholds& thresholds);

/// L(t) itself, the exponent cut at 80 as in the kernel. Returns [times][pixels].
std::vector<double> edi(std::span<const float> blurry, const PackedEvents& events,
                        std::span<const double> times, const EdiThresholds& thresholds);

/// What record_edi_fields() and record_edi_moments() compute, from frames of ln(L + e) at both ends
/// of every window: [edi_moment_count][edi_windows][tiles].
std::vector<double> edi_moments(std::span<const float> blurry, const PackedEvents& events,
                                uint32_t width, uint32_t height, const EdiThresholds& thresholds);

} // namespace ecir::reference

namespace ecir {

/// Up to `most` events a pixel for the cases: some at one time, some at the exposure's
/// ends and at 32nds of it.
PackedEvents random_packed_events(CaseRandom& random, size_t pixels, uint32_t most);

/// Cases of record_edi() (layers/edi.hpp) and of record_edi_moments() (layers/edi_moments.hpp).
Trial edi_trial(Device& device, uint32_t trial);
Trial edi_moments_trial(Device& device, uint32_t trial);

} // namespace ecir
