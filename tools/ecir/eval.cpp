#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "runtime/error.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/ecir/image_files.hpp"
#include "tools/ecir/metrics.hpp"
#include "tools/io/image.hpp"
#include "tools/io/npy.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
    fs::path truth;
    fs::path prediction;
    bool json = false;
    std::optional<double> min_psnr;
};

[[noreturn]] void refuse(const std::string& message) {
    throw Error(ExitCode::bad_input, message);
}

/// The frames of a folder (of images, or of one such folder for each exposure) or of a .npy, one in
/// memory at a time where they are files.
class Sequence {
public:
    explicit Sequence(const fs::path& path) : path_(path) {
        std::error_code ignored;
        if (fs::is_directory(path, ignored)) {
            list_images();
        } else if (fs::is_regular_file(path, ignored)) {
            read_array();
        } else {
            refuse(path.string() + ": no such folder or .npy file");
        }
    }

    [[nodiscard]] size_t size() const { return files_.empty() ? array_.shape[0] : files_.size(); }

    [[nodiscard]] std::string name(size_t index) const {
        return files_.empty() ? path_.string() + ", frame " + std::to_string(index)
                              : files_[index].string();
    }

    [[nodiscard]] metrics::Frame frame(size_t index) const {
        return files_.empty() ? from_array(index) : from_file(index);
    }

private:
    void list_images() {
        files_ = image_files(path_, false);
        if (files_.empty()) {
            files_ = image_files(path_, true);
        }
        if (files_.empty()) {
            refuse(path_.string() + ": holds no images (.png, .jpg or .tif)");
        }
    }

    void read_array() {
        array_ = io::read_npy(path_, &integers_);
        const auto& shape = array_.shape;
        const bool colour = shape.size() == 4 && shape[3] == 3;
        if (shape.size() != 3 && !colour) {
            refuse(path_.string() +
                   ": its shape must be frames x height x width, or the same x 3 "
                   "for colour; it has " +
                   std::to_string(shape.size()) + " dimensions");
        }
        if (array_.values.empty()) {
            refuse(path_.string() + ": holds no frames");
        }
        for (size_t i = 0; i < array_.values.size(); ++i) {
            if (!std::isfinite(array_.values[i])) {
                refuse(value_place(i) + " is not finite");
            }
            if (integers_ && array_.values[i] > 255) {
                refuse(value_place(i) + " is over 255; integers are 8-bit values, give others as "
                                        "floats in [0, 1]");
            }
        }
    }

    [[nodiscard]] std::string value_place(size_t index) const {
        const size_t frame = index / (array_.values.size() / array_.shape[0]);
        return path_.string() + ": a value of frame " + std::to_string(frame);
    }

    [[nodiscard]] metrics::Frame from_array(size_t index) const {
        const auto& shape = array_.shape;
        metrics::Frame frame{
            static_cast<int>(shape[2]), static_cast<int>(shape[1]), shape.size() == 4 ? 3 : 1, {}};
        const size_t count = array_.values.size() / shape[0];
        const auto values = std::span(array_.values).subspan(index * count, count);
        if (integers_) {
            frame.values.assign(values.begin(), values.end());
        } else {
            frame.values = metrics::to_8_bit(values);
        }
        return frame;
    }

    [[nodiscard]] metrics::Frame from_file(size_t index) const {
        const io::Image image = io::read_image(files_[index]);
        metrics::Frame frame{image.width, image.height, image.channels, {}};
        frame.values.resize(image.pixels.size());
        // From the stored integers, so that no rounding of v / (2^bits - 1) turns into a lost step:
        // truncating 255 v / 65535 is v / 257 in whole numbers.
        const float largest = image.bits == 16 ? 65535.0F : 255.0F;
        const int divisor = image.bits == 16 ? 257 : 1;
        std::transform(image.pixels.begin(), image.pixels.end(), frame.values.begin(),
                       [=](float value) {
                           return static_cast<uint8_t>(std::lround(value * largest) / divisor);
                       });
        return frame;
    }

    fs::path path_;
    std::vector<fs::path> files_; ///< empty for an array
    io::Array array_;
    bool integers_ = false;
};

std::string size_text(const metrics::Frame& frame) {
    return std::to_string(frame.width) + "x" + std::to_string(frame.height) +
           (frame.channels == 3 ? " colour" : " grey");
}

/// JSON has no infinity.
nlohmann::json number(double value) {
    return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

nlohmann::ordered_json to_json(const metrics::Figures& figures) {
    return {{"nrmse", number(figures.nrmse)},
            {"psnr", number(figures.psnr)},
            {"ssim", number(figures.ssim)}};
}

std::string fixed(double value, int digits) {
    if (!std::isfinite(value)) {
        return "infinite";
    }
    char text[64];
    std::snprintf(text, sizeof text, "%.*f", digits, value);
    return text;
}

std::vector<metrics::Figures> compare(const Options& options) {
    const Sequence truth(options.truth);
    const Sequence prediction(options.prediction);
    if (truth.size() != prediction.size()) {
        refuse("the truth " + options.truth.string() + " has " + std::to_string(truth.size()) +
               " frames, the prediction " + options.prediction.string() + " has " +
               std::to_string(prediction.size()));
    }
    std::vector<metrics::Figures> figures;
    for (size_t i = 0; i < truth.size(); ++i) {
        const metrics::Frame t = truth.frame(i);
        const metrics::Frame p = prediction.frame(i);
        if (t.width != p.width || t.height != p.height || t.channels != p.channels) {
            refuse("the truth " + truth.name(i) + " is " + size_text(t) + ", the prediction " +
                   prediction.name(i) + " is " + size_text(p));
        }
        if (t.width < 7 || t.height < 7) {
            refuse(truth.name(i) + " is " + size_text(t) +
                   "; SSIM's window needs at least 7 pixels a side");
        }
        figures.push_back(metrics::compare(t, p));
    }
    return figures;
}

void print_json(const std::vector<metrics::Figures>& frames, const metrics::Figures& mean,
                size_t identical) {
    nlohmann::ordered_json report = to_json(mean);
    report["frames"] = frames.size();
    report["identical_frames"] = identical;
    report["per_frame"] = nlohmann::ordered_json::array();
    for (const metrics::Figures& frame : frames) {
        report["per_frame"].push_back(to_json(frame));
    }
    std::cout << report.dump(2) << '\n';
}

void print_table(const std::vector<metrics::Figures>& frames, const metrics::Figures& mean) {
    std::cout << "frames  " << frames.size() << "\nnrmse   " << fixed(mean.nrmse, 4) << "\npsnr    "
              << fixed(mean.psnr, 2) << (std::isfinite(mean.psnr) ? " dB" : "") << "\nssim    "
              << fixed(mean.ssim, 4) << '\n';
}

void run(const Options& options) {
    if (options.min_psnr && std::isnan(*options.min_psnr)) {
        throw Error(ExitCode::usage, "--min-psnr takes a number of dB");
    }
    const std::vector<metrics::Figures> frames = compare(options);
    const metrics::Figures mean = metrics::mean(frames);
    const auto identical = static_cast<size_t>(
        std::count_if(frames.begin(), frames.end(),
                      [](const metrics::Figures& frame) { return std::isinf(frame.psnr); }));
    if (options.json) {
        print_json(frames, mean, identical);
    } else {
        print_table(frames, mean);
    }
    if (identical > 0) {
        std::cerr << "ecir: " << identical << " of " << frames.size()
                  << " frames are identical to the truth, so the mean PSNR is infinite\n";
    }
    if (std::isinf(mean.nrmse)) {
        std::cerr << "ecir: a truth frame is all black, so the mean NRMSE is infinite\n";
    }
    if (options.min_psnr && mean.psnr < *options.min_psnr) {
        throw Error(ExitCode::check_failed, "the mean PSNR of " + fixed(mean.psnr, 2) +
                                                " dB is below the bound of " +
                                                fixed(*options.min_psnr, 2) + " dB");
    }
}

} // namespace

void add_eval(CLI::App& app) {
    auto options = std::make_shared<Options>();
    CLI::App* command =
        app.add_subcommand("eval", "Compare predicted frames with the truth: NRMSE, PSNR, SSIM");
    command->add_option("--truth", options->truth, "True frames: a folder of images, or a .npy")
        ->required()
        ->option_text("PATH (required)");
    command
        ->add_option("--prediction", options->prediction,
                     "Predicted frames, as many and as large, matched in the order of their names")
        ->required()
        ->option_text("PATH (required)");
    command->add_flag("--json", options->json,
                      "Print JSON, with each frame's figures; null stands for infinite");
    command
        ->add_option("--min-psnr", options->min_psnr,
                     "Exit with 1 when the mean PSNR is below this many dB")
        ->option_text("DB");
    command->footer(
        "Definitions, over 8-bit values (floats are clipped to [0, 1], times 255, truncated) and\n"
        "averaged over frames:\n"
        "  nrmse  root mean square of the error / root mean square of the truth\n"
        "  psnr   10 log10(255^2 / mean squared error), dB\n"
        "  ssim   7x7 uniform window, K 0.01 and 0.03, sample covariance, 3-pixel border left out\n"
        "\n"
        "Example:\n"
        "  ecir eval --truth scene/truth --prediction sharp --min-psnr 25");
    command->callback([options] { run(*options); });
}

} // namespace ecir::cli
