#pragma once
#include <memory>
#include <string>

#include "layers/conv.hpp"
#include "runtime/device.hpp"

namespace ecir::cli {

inline const char* precision_name(Precision precision) {
    return precision == Precision::float16 ? "float16" : "float32";
}

/// The device with networks of that precision. Throws Error(usage) where it does not know it.
inline std::shared_ptr<Device> open_device(const std::string& selector, Precision precision) {
    auto device = Device::open(selector, precision);
    check_precision(device->info(), precision);
    return device;
}

} // namespace ecir::cli
