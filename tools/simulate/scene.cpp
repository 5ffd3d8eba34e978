#include "tools/simulate/scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "runtime/error.hpp"

namespace ecir::sim {
namespace {

/// The source pixels of one box along one axis and their shares.
struct Box {
    int first;
    std::vector<double> weights;
};

std::vector<Box> boxes(double start, double pitch, int count, int size) {
    std::vector<Box> result;
    result.reserve(static_cast<size_t>(count));
    for (int i = 0; i < count; ++i) {
        const double from = std::clamp(start + i * pitch, 0.0, static_cast<double>(size));
        const double to = std::clamp(start + (i + 1) * pitch, 0.0, static_cast<double>(size));
        const int first = std::min(static_cast<int>(from), size - 1);
        const int last = std::clamp(static_cast<int>(std::ceil(to)) - 1, first, size - 1);
        Box box{first, {}};
        double total = 0;
        for (int k = first; k <= last; ++k) {
            box.weights.push_back(std::max(0.0, std::min(to, k + 1.0) - std::max(from, k + 0.0)));
            total += box.weights.back();
        }
        for (double& weight : box.weights) {
            weight /= total;
        }
        result.push_back(std::move(box));
    }
    return result;
}

io::Image blank(int width, int height, int channels, int bits) {
    io::Image image{width, height, channels, bits, {}};
    image.pixels.resize(static_cast<size_t>(width) * static_cast<size_t>(height) *
                        static_cast<size_t>(channels));
    return image;
}

/// Mirrors an index into [0, size): -1 -> 0, size -> size - 1.
int mirror(int index, int size) {
    const int period = 2 * size;
    int i = index % period;
    if (i < 0) {
        i += period;
    }
    return i < size ? i : period - 1 - i;
}

std::string size_text(int width, int height) {
    return std::to_string(width) + "x" + std::to_string(height);
}

/// Frame pixels -> picture pixels: as coarse as the motion leaves room for, never under 1.
double fit(const io::Image& picture, const Trajectory& trajectory, int width, int height) {
    if (picture.width < width || picture.height < height) {
        throw Error(ExitCode::bad_input,
                    "the picture is " + size_text(picture.width, picture.height) +
                        ", smaller than the frames of " + size_text(width, height) +
                        "; give a larger picture or a smaller --size");
    }
    constexpr int samples = 64;
    double reach_x = 0;
    double reach_y = 0;
    for (int i = 0; i <= trajectory.exposures() * samples; ++i) {
        const Pose pose = trajectory.at(static_cast<double>(i) / samples);
        for (const double x : {-width / 2.0, width / 2.0}) {
            for (const double y : {-height / 2.0, height / 2.0}) {
                const auto point = unproject(pose, x, y);
                reach_x = std::max(reach_x, std::abs(point[0]));
                reach_y = std::max(reach_y, std::abs(point[1]));
            }
        }
    }
    return std::max(1.0, std::min(picture.width / (2 * reach_x), picture.height / (2 * reach_y)));
}

} // namespace

io::Image area_average(const io::Image& image, double left, double top, double pitch_x,
                       double pitch_y, int width, int height) {
    const auto columns = boxes(left, pitch_x, width, image.width);
    const auto rows = boxes(top, pitch_y, height, image.height);
    const auto channels = static_cast<size_t>(image.channels);
    const size_t source_row = static_cast<size_t>(image.width) * channels;
    const size_t target_row = static_cast<size_t>(width) * channels;
    io::Image result = blank(width, height, image.channels, image.bits);
    std::vector<double> sums(source_row);
    for (size_t y = 0; y < rows.size(); ++y) {
        std::fill(sums.begin(), sums.end(), 0.0);
        for (size_t k = 0; k < rows[y].weights.size(); ++k) {
            const float* source =
                image.pixels.data() + (static_cast<size_t>(rows[y].first) + k) * source_row;
            for (size_t i = 0; i < source_row; ++i) {
                sums[i] += rows[y].weights[k] * static_cast<double>(source[i]);
            }
        }
        for (size_t x = 0; x < columns.size(); ++x) {
            for (size_t c = 0; c < channels; ++c) {
                double value = 0;
                for (size_t k = 0; k < columns[x].weights.size(); ++k) {
                    const size_t column = static_cast<size_t>(columns[x].first) + k;
                    value += columns[x].weights[k] * sums[column * channels + c];
                }
                result.pixels[y * target_row + x * channels + c] = static_cast<float>(value);
            }
        }
    }
    return result;
}

StillScene::StillScene(const io::Image& picture, const Motion& motion, int width, int height,
                       double exposure_us, int exposures, int multiple)
    : trajectory_(motion, exposures), width_(width), height_(height), exposure_us_(exposure_us),
      sub_frames_(trajectory_.sub_frames(width, height, multiple)) {
    const double scale = fit(picture, trajectory_, width, height);
    const double density = std::min(2.0, scale);
    const auto shrunk = [&](int size) {
        return std::max(1, static_cast<int>(std::lround(size * density / scale)));
    };
    const int canvas_width = shrunk(picture.width);
    const int canvas_height = shrunk(picture.height);
    canvas_ = area_average(picture, 0, 0, static_cast<double>(picture.width) / canvas_width,
                           static_cast<double>(picture.height) / canvas_height, canvas_width,
                           canvas_height);
    density_x_ = canvas_width * scale / picture.width;
    density_y_ = canvas_height * scale / picture.height;
}

io::Image StillScene::at(double time_us) {
    const Pose pose = trajectory_.at(time_us / exposure_us_);
    io::Image frame = blank(width_, height_, canvas_.channels, canvas_.bits);
    const auto channels = static_cast<size_t>(canvas_.channels);
    float* out = frame.pixels.data();
    for (int y = 0; y < height_; ++y) {
        for (int x = 0; x < width_; ++x, out += channels) {
            for (int tap = 0; tap < 4; ++tap) {
                const auto point = unproject(pose, x + 0.25 + 0.5 * (tap & 1) - width_ / 2.0,
                                             y + 0.25 + 0.5 * (tap >> 1) - height_ / 2.0);
                // Pixel i covers [i, i + 1), its value sits in the middle.
                const double u = point[0] * density_x_ + canvas_.width / 2.0 - 0.5;
                const double v = point[1] * density_y_ + canvas_.height / 2.0 - 0.5;
                const double u0 = std::floor(u);
                const double v0 = std::floor(v);
                const auto fu = static_cast<float>(u - u0);
                const auto fv = static_cast<float>(v - v0);
                const auto index = [&](int dx, int dy) {
                    const int column = mirror(static_cast<int>(u0) + dx, canvas_.width);
                    const int row = mirror(static_cast<int>(v0) + dy, canvas_.height);
                    return (static_cast<size_t>(row) * static_cast<size_t>(canvas_.width) +
                            static_cast<size_t>(column)) *
                           channels;
                };
                const float* source = canvas_.pixels.data();
                const size_t i00 = index(0, 0), i10 = index(1, 0);
                const size_t i01 = index(0, 1), i11 = index(1, 1);
                for (size_t c = 0; c < channels; ++c) {
                    const float upper = source[i00 + c] * (1 - fu) + source[i10 + c] * fu;
                    const float lower = source[i01 + c] * (1 - fu) + source[i11 + c] * fu;
                    out[c] += 0.25F * (upper * (1 - fv) + lower * fv);
                }
            }
        }
    }
    return frame;
}

std::vector<double> StillScene::knots(double start_us, double end_us) const {
    const double step = exposure_us_ / sub_frames_;
    std::vector<double> result{start_us};
    for (auto i = static_cast<int64_t>(std::floor(start_us / step)) + 1;; ++i) {
        const double time = static_cast<double>(i) * step;
        if (time >= end_us) {
            break;
        }
        result.push_back(time);
    }
    result.push_back(end_us);
    return result;
}

FrameScene::FrameScene(std::vector<std::filesystem::path> files, double fps, int width, int height)
    : files_(std::move(files)), interval_us_(1e6 / fps), width_(width), height_(height) {
    if (!(fps > 0 && fps <= 1e6)) {
        throw Error(ExitCode::usage, "--fps must lie between 0 and 1000000");
    }
    for (Cached& entry : cache_) {
        entry.index = std::numeric_limits<size_t>::max();
    }
}

double FrameScene::end_us() const {
    return static_cast<double>(files_.size() - 1) * interval_us_;
}

const io::Image& FrameScene::frame(size_t index) {
    Cached& entry = cache_[index % 2];
    if (entry.index == index) {
        return entry.image;
    }
    const std::filesystem::path& file = files_[index];
    const io::Image image = io::read_image(file);
    const std::string size = file.string() + " is " + size_text(image.width, image.height);
    if (source_width_ == 0) {
        source_width_ = image.width;
        source_height_ = image.height;
    } else if (image.width != source_width_ || image.height != source_height_) {
        throw Error(ExitCode::bad_input, size + ", the frames before it are " +
                                             size_text(source_width_, source_height_));
    }
    const double pitch = std::min(static_cast<double>(image.width) / width_,
                                  static_cast<double>(image.height) / height_);
    if (pitch < 1) {
        throw Error(ExitCode::bad_input, size + ", smaller than the frames of " +
                                             size_text(width_, height_) +
                                             "; give a smaller --size");
    }
    entry.image = area_average(image, (image.width - width_ * pitch) / 2,
                               (image.height - height_ * pitch) / 2, pitch, pitch, width_, height_);
    entry.index = index;
    return entry.image;
}

io::Image FrameScene::at(double time_us) {
    const double position =
        std::clamp(time_us / interval_us_, 0.0, static_cast<double>(files_.size() - 1));
    const auto index = static_cast<size_t>(position);
    const auto share = static_cast<float>(position - static_cast<double>(index));
    io::Image result = frame(index);
    if (share > 0) {
        const io::Image& next = frame(index + 1);
        if (next.channels != result.channels) {
            throw Error(ExitCode::bad_input,
                        files_[index + 1].string() + ": grey and colour frames are mixed");
        }
        for (size_t i = 0; i < result.pixels.size(); ++i) {
            result.pixels[i] += share * (next.pixels[i] - result.pixels[i]);
        }
    }
    return result;
}

std::vector<double> FrameScene::knots(double start_us, double end_us) const {
    std::vector<double> result{start_us};
    for (size_t i = 0; i < files_.size(); ++i) {
        const double time = static_cast<double>(i) * interval_us_;
        if (time > start_us && time < end_us) {
            result.push_back(time);
        }
    }
    result.push_back(end_us);
    return result;
}

} // namespace ecir::sim
