#pragma once
#include <filesystem>
#include <functional>
#include <string>

#include "weights/safetensors.hpp"

namespace ecir::stability {

/// A weights file with some values changed, in the folder for temporary files as long as this
/// lives.
class WeightsCopy {
public:
    /// change(name of the tensor, value) is the new value. Throws Error(resources) where the file
    /// cannot be written.
    WeightsCopy(const SafeTensors& weights,
                const std::function<float(const std::string&, float)>& change);
    ~WeightsCopy();
    WeightsCopy(const WeightsCopy&) = delete;
    WeightsCopy& operator=(const WeightsCopy&) = delete;

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
};

} // namespace ecir::stability
