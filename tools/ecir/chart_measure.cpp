#include "tools/ecir/chart_measure.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <span>

#include "layers/deblur.hpp"
#include "layers/ecir.hpp"
#include "runtime/error.hpp"
#include "tools/ecir/bench_timing.hpp"
#include "tools/ecir/image_files.hpp"
#include "tools/ecir/resize.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/recording.hpp"
#include "weights/safetensors.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

constexpr size_t kRuns = 3; ///< timed, of each scene

[[noreturn]] void refuse(const std::string& message) {
    throw Error(ExitCode::bad_input, message);
}

bool is_scene(const fs::path& folder) {
    std::error_code error;
    return fs::is_regular_file(folder / "exposures.csv", error) &&
           fs::is_directory(folder / "truth", error);
}

metrics::Frame grey_frame(const io::Image& image) {
    return {image.width, image.height, 1, metrics::to_8_bit(io::luminance(image))};
}

ChartScene read_scene(const fs::path& folder) {
    const io::Recording recording = io::open_recording(folder);
    if (recording.items.size() != 1) {
        refuse(folder.string() + ": has " + std::to_string(recording.items.size()) +
               " exposures; a scene of the chart has one");
    }
    const auto& item = recording.items.front();
    ChartScene scene;
    scene.exposure = item.exposure;
    scene.blurry = recording.read(item);
    scene.blurry.pixels = io::luminance(scene.blurry);
    scene.blurry.channels = 1;
    scene.events = io::read_events(recording.events).events;
    io::check_inside(scene.events.view(), scene.blurry.width, scene.blurry.height,
                     recording.events);
    for (const fs::path& file : image_files(folder / "truth", false)) {
        const std::string number = file.stem().string();
        size_t place = 0;
        const auto [end, error] =
            std::from_chars(number.data(), number.data() + number.size(), place);
        if (error == std::errc{} && end == number.data() + number.size() &&
            place != scene.truth.size()) {
            refuse(file.string() + ": is number " + std::to_string(scene.truth.size()) +
                   " of the frames there; frames are missing, and times follow from their count");
        }
        scene.truth.push_back(grey_frame(io::read_image(file)));
        if (scene.truth.back().width != scene.blurry.width ||
            scene.truth.back().height != scene.blurry.height) {
            refuse(file.string() + ": is of another size than the blurry frame");
        }
    }
    if (scene.truth.empty()) {
        refuse((folder / "truth").string() + ": holds no images");
    }
    return scene;
}

/// A scene as a point works on it.
struct Work {
    std::vector<float> blurry;
    Events events;
    PixelSize size;
};

Work prepare(const ChartPoint& point, const ChartScene& scene) {
    const int width = scene.blurry.width;
    const int height = scene.blurry.height;
    if (point.scale == 1) {
        return {scene.blurry.pixels, scene.events, {width, height}};
    }
    const PixelSize size{static_cast<int>(std::lround(width * point.scale)),
                         static_cast<int>(std::lround(height * point.scale))};
    return {resize_area(scene.blurry, size).pixels,
            scale_events(scene.events.view(), width, height, size), size};
}

Deblur make_deblur(const ChartPoint& point, const std::shared_ptr<Device>& device,
                   const PixelSize& size, const std::optional<EdiThresholds>& thresholds = {}) {
    DeblurOptions options;
    options.model = point.model;
    options.refine = point.refine;
    options.quality = point.quality.value_or(options.quality);
    options.regions = point.quality.has_value();
    options.thresholds = thresholds;
    return {device, options, static_cast<uint32_t>(size.width), static_cast<uint32_t>(size.height)};
}

/// Each of the frames, enlarged where it is smaller, with the truth.
std::vector<metrics::Figures> compare(const Work& work, const ChartScene& scene,
                                      std::span<const float> frames) {
    std::vector<metrics::Figures> figures;
    const size_t count = work.blurry.size();
    for (size_t i = 0; i < scene.truth.size(); ++i) {
        const auto pixels = frames.subspan(i * count, count);
        io::Image frame;
        frame.width = work.size.width;
        frame.height = work.size.height;
        frame.pixels.assign(pixels.begin(), pixels.end());
        if (frame.width != scene.blurry.width || frame.height != scene.blurry.height) {
            frame = resize_cubic(frame, {scene.blurry.width, scene.blurry.height});
        }
        figures.push_back(metrics::compare(scene.truth[i], grey_frame(frame)));
    }
    return figures;
}

/// A model with the values of --refine to compare; unset: as trained.
std::vector<ChartPoint> refinements(const std::string& model, uint32_t most) {
    if (model == "edi") {
        return {{}};
    }
    const SafeTensors weights(find_model(model));
    const std::string kind = weights.meta("model");
    std::vector<ChartPoint> made;
    if (kind == "ecir") {
        for (uint32_t iterations = 0; iterations <= most; ++iterations) {
            ChartPoint& point = made.emplace_back();
            point.keypoints = EcirConfig(weights).keypoints;
            point.refine = iterations;
        }
        return made;
    }
    made.emplace_back();
    if (kind == "fusion") {
        made.emplace_back().refine = 0;
        made.emplace_back().refine = 1;
    }
    return made;
}

} // namespace

std::vector<ChartScene> read_chart_scenes(const fs::path& folder) {
    std::vector<fs::path> folders;
    std::error_code error;
    if (is_scene(folder)) {
        folders.push_back(folder);
    } else {
        for (const auto& entry : fs::directory_iterator(folder, error)) {
            if (is_scene(entry.path())) {
                folders.push_back(entry.path());
            }
        }
    }
    if (folders.empty()) {
        refuse(folder.string() + ": holds no scenes, which are folders with exposures.csv and " +
               "truth/ as `ecir simulate` writes them");
    }
    std::ranges::sort(folders);
    std::vector<ChartScene> scenes;
    for (const fs::path& each : folders) {
        scenes.push_back(read_scene(each));
        const ChartScene& first = scenes.front();
        const ChartScene& last = scenes.back();
        if (last.blurry.width != first.blurry.width || last.blurry.height != first.blurry.height ||
            last.truth.size() != first.truth.size()) {
            refuse(each.string() + ": has another size or number of frames than " +
                   folders.front().string() + "; times would not compare");
        }
    }
    return scenes;
}

std::vector<ChartPoint> chart_configurations(const std::vector<std::string>& models,
                                             uint32_t most_refine,
                                             const std::vector<Precision>& precisions) {
    std::vector<ChartPoint> points;
    for (const double scale : {1.0, 0.5}) {
        for (const std::string& model : models) {
            std::vector<ChartPoint> made;
            if (model == "auto") {
                for (const Quality quality : {Quality::fast, Quality::balanced, Quality::best}) {
                    made.emplace_back().quality = quality;
                }
            } else {
                made = refinements(model, most_refine);
            }
            for (const Precision precision : precisions) {
                for (ChartPoint& point : made) {
                    point.model = model;
                    point.scale = scale;
                    point.precision = precision;
                    points.push_back(point);
                }
                if (model == "edi") { // without convolutions
                    break;
                }
            }
        }
    }
    return points;
}

void measure(ChartPoint& point, const std::shared_ptr<Device>& device,
             const std::vector<ChartScene>& scenes) {
    std::vector<metrics::Figures> figures;
    const auto each = 1.0 / static_cast<double>(scenes.size());
    for (const ChartScene& scene : scenes) {
        const Work work = prepare(point, scene);
        const auto times = even_times(static_cast<uint32_t>(scene.truth.size()));
        // A new object for each: thresholds that it carries on are one sensor's.
        Deblur first = make_deblur(point, device, work.size);
        const auto frames = first.frames(work.blurry, work.events.view(), scene.exposure, times);
        const auto found = compare(work, scene, frames);
        figures.insert(figures.end(), found.begin(), found.end());
        // A recording's thresholds settle and are not estimated any more.
        Deblur settled = make_deblur(point, device, work.size, first.thresholds());
        std::array<double, kRuns + 1> ms{};
        for (double& took : ms) {
            const double start = now_ms();
            (void)settled.frames(work.blurry, work.events.view(), scene.exposure, times);
            took = now_ms() - start;
        }
        std::sort(ms.begin() + 1, ms.end()); // the first one records
        const double median = ms.at(1 + kRuns / 2);
        point.ms += each * median;
        point.ms_most = std::max(point.ms_most, median);
        point.gflop += each * settled.operations() * 1e-9;
    }
    const metrics::Figures mean = metrics::mean(figures);
    point.psnr = mean.psnr;
    point.ssim = mean.ssim;
}

} // namespace ecir::cli
