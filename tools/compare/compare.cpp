// usage: ecir_compare RECORDING FRAMES TRUTH OUT.png
// One picture of a recording's first exposure: the blurry frame and its events, then at three times
// the frame of folder FRAMES above the true one of folder TRUTH. Both folders: images, evenly over
// the exposure.
#include <algorithm>
#include <array>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "runtime/error.hpp"
#include "tools/ecir/image_files.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/recording.hpp"

namespace {

namespace fs = std::filesystem;

constexpr int kTileWidth = 480; ///< roughly: small frames are enlarged by a whole factor
constexpr int kMargin = 24;
constexpr int kGap = 16;
constexpr int kCaption = 44;
const cv::Scalar kPaper(255, 255, 255);
const cv::Scalar kInk(40, 40, 40);
const cv::Scalar kFrame(200, 200, 200);

struct Tile {
    cv::Mat picture;
    std::string caption;
};

cv::Mat read(const fs::path& path) {
    cv::Mat picture = cv::imread(path.string(), cv::IMREAD_COLOR);
    if (picture.empty()) {
        throw ecir::Error(ecir::ExitCode::bad_input,
                          path.string() + ": cannot be read as an image");
    }
    return picture;
}

/// Events summed over the exposure: red where it became brighter, blue where darker.
cv::Mat draw_events(const ecir::EventView& events, cv::Size size) {
    cv::Mat sum(size, CV_32S, cv::Scalar(0));
    for (size_t i = 0; i < events.size(); ++i) {
        sum.at<int>(events.y[i], events.x[i]) += events.p[i] != 0 ? 1 : -1;
    }
    constexpr int kFull = 6; // this many give the full colour
    cv::Mat picture(size, CV_8UC3);
    for (int y = 0; y < size.height; ++y) {
        for (int x = 0; x < size.width; ++x) {
            const int count = std::clamp(sum.at<int>(y, x), -kFull, kFull);
            const auto pale = static_cast<uchar>(255 - 255 * std::abs(count) / kFull);
            const auto strong = static_cast<uchar>(255 - 55 * std::abs(count) / kFull);
            picture.at<cv::Vec3b>(y, x) =
                count > 0 ? cv::Vec3b(pale, pale, strong) : cv::Vec3b(strong, pale, pale);
        }
    }
    return picture;
}

void place(cv::Mat& sheet, const Tile& tile, cv::Point corner, cv::Size size) {
    cv::Mat picture;
    cv::resize(tile.picture, picture, size, 0, 0, cv::INTER_NEAREST);
    const cv::Rect area(corner, size);
    picture.copyTo(sheet(area));
    cv::rectangle(sheet, area + cv::Size(2, 2) - cv::Point(1, 1), kFrame);
    constexpr double kScale = 0.75;
    int below = 0;
    const cv::Size text = cv::getTextSize(tile.caption, cv::FONT_HERSHEY_DUPLEX, kScale, 1, &below);
    cv::putText(sheet, tile.caption,
                corner + cv::Point((size.width - text.width) / 2, size.height + 30),
                cv::FONT_HERSHEY_DUPLEX, kScale, kInk, 1, cv::LINE_AA);
}

/// Columns of two tiles.
cv::Mat arrange(const std::vector<std::array<Tile, 2>>& columns) {
    const cv::Size frame = columns.front()[0].picture.size();
    const cv::Size size = frame * std::max(1, (kTileWidth + frame.width / 2) / frame.width);
    const int step_x = size.width + kGap;
    const int step_y = size.height + kCaption;
    cv::Mat sheet(2 * kMargin + 2 * step_y - kGap,
                  2 * kMargin + static_cast<int>(columns.size()) * step_x - kGap, CV_8UC3, kPaper);
    for (size_t i = 0; i < columns.size(); ++i) {
        for (int row = 0; row < 2; ++row) {
            place(sheet, columns[i][static_cast<size_t>(row)],
                  {kMargin + static_cast<int>(i) * step_x, kMargin + row * step_y}, size);
        }
    }
    return sheet;
}

std::string with_time(const char* what, size_t index, size_t count) {
    const double time =
        count == 1 ? 0 : -1 + 2 * static_cast<double>(index) / static_cast<double>(count - 1);
    std::array<char, 64> text{};
    std::snprintf(text.data(), text.size(), "%s, t = %.2g", what, time);
    return text.data();
}

void compare(const fs::path& folder, const fs::path& frame_folder, const fs::path& truth_folder,
             const fs::path& out) {
    const auto recording = ecir::io::open_recording(folder);
    const auto& item = recording.items.front();
    const cv::Mat blurry = read(recording.full_name(item));
    const auto file = ecir::io::read_events(recording.events);
    const auto events = ecir::window(file.events.view(), item.exposure);
    ecir::io::check_inside(events, blurry.cols, blurry.rows, recording.events);
    const auto frames = ecir::cli::image_files(frame_folder, false);
    const auto truth = ecir::cli::image_files(truth_folder, false);
    if (frames.empty() || frames.size() != truth.size()) {
        throw ecir::Error(ecir::ExitCode::bad_input,
                          frame_folder.string() + " holds " + std::to_string(frames.size()) +
                              " images and " + truth_folder.string() + " " +
                              std::to_string(truth.size()) + "; both must hold the same times");
    }

    std::vector<std::array<Tile, 2>> columns;
    columns.push_back(
        {{{blurry, "blurry frame"},
          {draw_events(events, blurry.size()), "its events: " + std::to_string(events.size())}}});
    for (const size_t i : {size_t{0}, frames.size() / 2, frames.size() - 1}) {
        columns.push_back({{{read(frames[i]), with_time("ecir", i, frames.size())},
                            {read(truth[i]), with_time("truth", i, frames.size())}}});
    }
    if (!cv::imwrite(out.string(), arrange(columns))) {
        throw ecir::Error(ecir::ExitCode::resources, out.string() + ": cannot be written");
    }
}

} // namespace

int main(int argc, char** argv) {
    if (argc != 5) {
        std::fprintf(stderr, "usage: ecir_compare RECORDING FRAMES TRUTH OUT.png\n");
        return static_cast<int>(ecir::ExitCode::usage);
    }
    try {
        compare(argv[1], argv[2], argv[3], argv[4]);
    } catch (const ecir::Error& error) {
        std::fprintf(stderr, "ecir_compare: %s\n", error.what());
        return static_cast<int>(error.code());
    } catch (const std::exception& error) {
        std::fprintf(stderr, "ecir_compare: %s\n", error.what());
        return static_cast<int>(ecir::ExitCode::bad_input);
    }
    return 0;
}
