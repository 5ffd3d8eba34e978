#pragma once
#include <string>
#include <utility>
#include <vector>

#include "tools/stability/capture.hpp"

namespace ecir::stability {

using Signs = std::vector<std::pair<std::string, double>>;

/// What can be told of a condition from the blurry frame and the events of its exposure alone, to
/// choose what to warn of and from where on:
/// saturated, dark         share of pixels from 0.97 on, and up to 0.03
/// events a pixel          mean over all pixels
/// active                  share of pixels with an event
/// busiest pixel           largest number of events of a pixel
/// balance                 (positive - negative) / all events
/// same time               share of the most frequent microsecond
/// fullest, empty          share of the events in the fullest hundredth of the exposure; share of
///                         hundredths without one
/// 100 Hz, 120 Hz          |sum of sign exp(-2 pi i f t)| / events: what flickers in step
/// unsupported             share of events without one of a neighbouring pixel in the twentieth of
///                         the exposure before it
Signs signs_of(const Capture& capture);

} // namespace ecir::stability
