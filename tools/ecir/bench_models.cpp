#include "tools/ecir/bench_models.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "layers/fusion.hpp"
#include "layers/operations.hpp"
#include "tools/ecir/precision.hpp"
#include "weights/safetensors.hpp"

namespace ecir::cli {
namespace {

/// Brightness as a sum of waves, moving.
class Texture {
public:
    explicit Texture(CaseRandom& random) {
        for (Wave& wave : waves_) {
            const double angle = random.uniform(0, 6.28);
            const double wave_number = 6.28 / random.uniform(8, 60); // pixels
            wave = {wave_number * std::cos(angle), wave_number * std::sin(angle),
                    random.uniform(0, 6.28)};
        }
    }

    /// time: -1 to 1.
    [[nodiscard]] double brightness(double x, double y, double time) const {
        double sum = 0.5;
        for (const Wave& wave : waves_) {
            sum += kAmplitude * std::sin(wave.phase_at(x, y, time));
        }
        return sum;
    }
    /// Change of the logarithm of brightness a unit of time.
    [[nodiscard]] double change(double x, double y, double time) const {
        double sum = 0;
        for (const Wave& wave : waves_) {
            sum += kAmplitude * std::cos(wave.phase_at(x, y, time)) * wave.frequency();
        }
        return sum / brightness(x, y, time);
    }

private:
    static constexpr double kAmplitude = 0.06;
    static constexpr double kSpeedX = 6; ///< pixels a unit of time
    static constexpr double kSpeedY = 2.5;

    struct Wave {
        double x = 0; ///< wave numbers
        double y = 0;
        double phase = 0;
        [[nodiscard]] double frequency() const { return -(x * kSpeedX + y * kSpeedY); }
        [[nodiscard]] double phase_at(double column, double row, double time) const {
            return x * column + y * row + frequency() * time + phase;
        }
    };
    std::array<Wave, 6> waves_;
};

/// Iterations of the refinement that a model makes.
uint32_t iterations(const ModelCase& work) {
    if (work.refine || work.model == "edi") {
        return work.refine.value_or(0);
    }
    const SafeTensors weights(find_model(work.model));
    if (weights.meta("model") == "ecir") {
        return weights.meta_count("iterations", 0, 1000);
    }
    return weights.meta("model") == "fusion" ? static_cast<uint32_t>(FusionSteps::agreed) : 0;
}

DeblurOptions options_of(const ModelCase& work) {
    DeblurOptions options;
    options.model = work.model;
    options.refine = work.refine;
    options.refine_until = 0; // as much work as is asked for, whatever the weights
    return options;
}

} // namespace

BenchScene::BenchScene(const PixelSize& size) {
    constexpr uint32_t kEvents = 100'000;
    constexpr int kMoments = 9; // of the exposure in the blurry frame
    CaseRandom random(7);
    const Texture texture(random);
    blurry.width = size.width;
    blurry.height = size.height;
    for (int y = 0; y < size.height; ++y) {
        for (int x = 0; x < size.width; ++x) {
            double sum = 0;
            for (int k = 0; k < kMoments; ++k) {
                sum += texture.brightness(x, y, 2.0 * k / (kMoments - 1) - 1);
            }
            blurry.pixels.push_back(static_cast<float>(sum / kMoments));
        }
    }
    const auto last_column = static_cast<uint32_t>(size.width - 1);
    const auto last_row = static_cast<uint32_t>(size.height - 1);
    double fastest = 0;
    for (int i = 0; i < 1000; ++i) {
        fastest = std::max(
            fastest, std::abs(texture.change(random.integer(0, last_column),
                                             random.integer(0, last_row), random.uniform(-1, 1))));
    }
    while (events.size() < kEvents) {
        const double share = static_cast<double>(events.size()) / kEvents;
        const uint32_t x = random.integer(0, last_column - 1);
        const uint32_t y = random.integer(0, last_row);
        const double change = texture.change(x, y, 2 * share - 1);
        if (random.uniform(0, fastest) < std::abs(change)) {
            const int64_t time =
                exposure.start +
                static_cast<int64_t>(share * static_cast<double>(exposure.duration()));
            // Two side by side: single ones would pass for noise, and nothing be computed.
            for (const uint32_t column : {x, x + 1}) {
                events.push_back(time, static_cast<uint16_t>(column), static_cast<uint16_t>(y),
                                 change > 0 ? 1 : 0);
            }
        }
    }
}

ModelRun::ModelRun(const std::shared_ptr<Device>& device, const ModelCase& work)
    : scene_(work.size), deblur_(device, options_of(work), static_cast<uint32_t>(work.size.width),
                                 static_cast<uint32_t>(work.size.height)),
      times_(even_times(work.frames)) {}

std::vector<float> ModelRun::operator()() {
    return deblur_.frames(scene_.blurry.pixels, scene_.events.view(), scene_.exposure, times_);
}

void ModelRun::begin() {
    deblur_.begin(scene_.blurry.pixels, scene_.events.view(), scene_.exposure, times_);
}

ModelRow bench_model(const std::shared_ptr<Device>& device, const ModelCase& work) {
    ModelRun run(device, work);
    ModelRow row;
    row.name = work.model;
    row.size = std::to_string(work.size.width) + "x" + std::to_string(work.size.height);
    row.frames = work.frames;
    row.refine = iterations(work);
    row.precision = precision_name(device->precision());
    const auto frames = run();
    row.ok = std::ranges::all_of(frames, [](float value) { return std::isfinite(value); }) &&
             frames == run();
    // Which also makes what only a stream needs.
    run.begin();
    run.begin();
    row.ok = row.ok && frames == run.finish();
    if (row.ok) {
        row.stream = repeat([&] {
            const double start = now_ms();
            run.begin();
            (void)run.finish();
            return now_ms() - start;
        });
    }
    row.ok = frames == run.finish() && row.ok;
    if (row.ok) {
        row.time = repeat([&] {
            const double start = now_ms();
            (void)run();
            return now_ms() - start;
        });
    }
    return row;
}

} // namespace ecir::cli
