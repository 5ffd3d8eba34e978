#include <opencv2/core.hpp>
#include <string>

#include "aedat4_generated.h"
#include "runtime/error.hpp"
#include "tools/io/aedat4.hpp"
#include "tools/io/recording_formats.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

const aedat4::Frame& frame_of(std::span<const uint8_t> bytes) {
    return *flatbuffers::GetSizePrefixedRoot<aedat4::Frame>(bytes.data());
}

/// Of the pixels, not of the readout. None where the file states none.
std::optional<Exposure> exposure_of(const aedat4::Frame& frame) {
    Exposure exposure{frame.exposure_start(), frame.exposure_end()};
    if (exposure.start == 0 && exposure.end == 0) {
        exposure = {frame.time(), frame.time() + frame.exposure()};
    }
    if (exposure.end <= exposure.start || exposure.start < -max_exposure_time ||
        exposure.end > max_exposure_time) {
        return std::nullopt;
    }
    return exposure;
}

class Aedat4Frames final : public FrameSource {
public:
    explicit Aedat4Frames(const fs::path& path) : stream_(path, Aedat4Stream::Kind::frames) {}

    [[nodiscard]] size_t count() const { return stream_.packets().size(); }
    std::optional<Exposure> exposure(size_t frame) {
        return exposure_of(frame_of(stream_.unpack(stream_.packets()[frame])));
    }

    Image read(size_t frame) override {
        const auto& stored = frame_of(stream_.unpack(stream_.packets()[frame]));
        const int type = stored.format();
        const int width = stored.width();
        const int height = stored.height();
        if (type != CV_8UC1 && type != CV_8UC3 && type != CV_8UC4) {
            fail(frame, "has pixels of OpenCV's type " + std::to_string(type),
                 "record 8 bits, grey, BGR or BGRA");
        }
        if (stored.left() != 0 || stored.top() != 0) {
            fail(frame,
                 "is a cut-out from column " + std::to_string(stored.left()) + ", row " +
                     std::to_string(stored.top()),
                 "record the sensor's whole frames");
        }
        const auto* pixels = stored.pixels();
        const auto channels = static_cast<size_t>(CV_MAT_CN(type));
        if (pixels == nullptr || width <= 0 || height <= 0 ||
            pixels->size() != static_cast<size_t>(width) * static_cast<size_t>(height) * channels) {
            fail(frame,
                 "of " + std::to_string(width) + " x " + std::to_string(height) + " has " +
                     std::to_string(pixels == nullptr ? 0 : pixels->size()) + " bytes",
                 "copy the file again");
        }
        return image_from_bytes({pixels->data(), pixels->size()}, width, height,
                                static_cast<int>(channels));
    }

private:
    [[noreturn]] void fail(size_t frame, const std::string& what, const std::string& remedy) const {
        throw Error(ExitCode::bad_input, stream_.path().string() + ": frame " +
                                             std::to_string(frame) + " " + what + "; " + remedy);
    }

    Aedat4Stream stream_;
};

} // namespace

bool aedat4_holds_frames(const fs::path& path) {
    return Aedat4Stream(path, Aedat4Stream::Kind::frames).found();
}

Recording open_aedat4_recording(const fs::path& path) {
    auto frames = std::make_shared<Aedat4Frames>(path);
    Recording recording;
    recording.place = path;
    recording.events = path;
    for (size_t i = 0; i < frames->count(); ++i) {
        if (const auto exposure = frames->exposure(i)) {
            recording.items.push_back({"frame " + std::to_string(i), *exposure, i});
        }
    }
    const size_t without = frames->count() - recording.items.size();
    if (recording.items.empty()) {
        throw Error(ExitCode::bad_input,
                    path.string() + ": none of its " + std::to_string(without) +
                        " frames states its exposure; save the frames as images, and give their "
                        "exposures in a recording's folder (exposures.csv)");
    }
    if (without > 0) {
        recording.note = path.string() + ": " + std::to_string(without) + " of " +
                         std::to_string(frames->count()) +
                         " frames do not state their exposure and are left out";
    }
    recording.frames = std::move(frames);
    return recording;
}

} // namespace ecir::io
