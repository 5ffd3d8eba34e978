#pragma once
#include <memory>
#include <optional>
#include <string>

#include "layers/deblur.hpp"
#include "tools/ecir/bench_report.hpp"
#include "tools/ecir/resize.hpp"

namespace ecir::cli {

/// A model with what it is given to do.
struct ModelCase {
    std::string model; ///< as for `ecir deblur -m`
    PixelSize size{240, 180};
    uint32_t frames = 14;
    std::optional<uint32_t> refine;
    Precision precision = Precision::float32; ///< of the device that it runs on
};

/// A texture that moves over an image, and the events of it.
struct BenchScene {
    io::Image blurry; ///< grey
    Events events;    ///< 100,000, falling where and when brightness changes fastest
    Exposure exposure{0, 120'000};

    explicit BenchScene(const PixelSize& size);
};

/// A model on the device with its scene, from host memory to host memory; runs have the same input.
class ModelRun {
public:
    ModelRun(const std::shared_ptr<Device>& device, const ModelCase& work);
    std::vector<float> operator()();
    /// The same in the two halves of Deblur.
    void begin();
    std::vector<float> finish() { return deblur_.finish(); }

private:
    BenchScene scene_;
    Deblur deblur_;
    std::vector<double> times_;
};

/// Runs the model twice and compares, then times it in its steady state: each frame by itself, and
/// in a stream, where the next one has begun before one is finished.
ModelRow bench_model(const std::shared_ptr<Device>& device, const ModelCase& work);

/// Start-up by runs of this program in a folder of their own, with caches of their own (those of
/// this program, of Mesa and of NVIDIA's driver). steady_ms: what bench_model() measured.
StartTimes bench_start(const DeviceInfo& device, const ModelCase& work, double steady_ms);

} // namespace ecir::cli
