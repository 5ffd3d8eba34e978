#include "tools/io/recording.hpp"

#include <algorithm>
#include <charconv>
#include <string>
#include <string_view>

#include "runtime/error.hpp"
#include "tools/io/aedat4.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/file.hpp"
#include "tools/io/recording_formats.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

constexpr const char* list_name = "exposures.csv";
constexpr std::string_view header = "file,start_us,end_us";

[[noreturn]] void fail(const fs::path& path, const std::string& what, const std::string& remedy) {
    throw Error(ExitCode::bad_input, path.string() + ": " + what + "; " + remedy);
}

std::string_view trim(std::string_view text) {
    constexpr const char* blanks = " \t\r";
    const size_t first = text.find_first_not_of(blanks);
    return first == std::string_view::npos
               ? std::string_view()
               : text.substr(first, text.find_last_not_of(blanks) - first + 1);
}

/// Reads exposures.csv line by line into the recording's items.
class ListParser {
public:
    explicit ListParser(const fs::path& folder) : folder_(folder), path_(folder / list_name) {}

    std::vector<Recording::Item> parse(std::string_view text) {
        while (!text.empty()) {
            ++number_;
            const size_t length = std::min(text.find('\n'), text.size());
            const std::string_view line = trim(text.substr(0, length));
            text.remove_prefix(std::min(length + 1, text.size()));
            if (number_ == 1) {
                check_header(line);
            } else if (!line.empty()) {
                add(line);
            }
        }
        if (items_.empty()) {
            io::fail(path_, "names no image",
                     "write `" + std::string(header) + "`, then a line an image");
        }
        return std::move(items_);
    }

private:
    [[noreturn]] void fail(const std::string& what, const std::string& remedy) const {
        io::fail(path_, "line " + std::to_string(number_) + " " + what, remedy);
    }

    void check_header(std::string_view line) const {
        constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";
        if (line.starts_with(byte_order_mark)) {
            line.remove_prefix(byte_order_mark.size());
        }
        if (line != header) {
            fail("is not the header", "write `" + std::string(header) + "`");
        }
    }

    void add(std::string_view line) {
        if (std::ranges::count(line, ',') != 2) {
            fail("does not have three columns", "write `" + std::string(header) + "`");
        }
        const size_t first = line.find(',');
        const size_t second = line.find(',', first + 1);
        const Exposure exposure = {number(line.substr(first + 1, second - first - 1), "start"),
                                   number(line.substr(second + 1), "end")};
        if (exposure.end <= exposure.start) {
            fail("has an exposure that ends at " + std::to_string(exposure.end) +
                     " us, not after its start at " + std::to_string(exposure.start) + " us",
                 "write the start before the end");
        }
        items_.push_back({image(trim(line.substr(0, first))), exposure, 0});
    }

    [[nodiscard]] std::string image(std::string_view name) const {
        const fs::path relative = fs::path(name).lexically_normal();
        if (name.empty() || relative.is_absolute() || *relative.begin() == "..") {
            fail("names the image '" + std::string(name) + "', which is not inside the folder",
                 "put the images into the recording's folder");
        }
        std::error_code problem;
        if (!fs::is_regular_file(folder_ / relative, problem)) {
            fail("names the image '" + std::string(name) + "', which is not there",
                 "add the file or remove the line");
        }
        return relative.string();
    }

    int64_t number(std::string_view column, const char* name) const {
        const std::string_view text = trim(column);
        int64_t value = 0;
        const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (problem != std::errc() || end != text.data() + text.size() ||
            value > max_exposure_time || value < -max_exposure_time) {
            fail("has the " + std::string(name) + " '" + std::string(text) +
                     "', which is not an integer of microseconds",
                 "write the time in whole microseconds on the events' clock");
        }
        return value;
    }

    const fs::path& folder_;
    fs::path path_;
    size_t number_ = 0;
    std::vector<Recording::Item> items_;
};

fs::path find_events(const fs::path& folder, const std::vector<Recording::Item>& items) {
    std::vector<std::string_view> images;
    images.reserve(items.size());
    for (const auto& item : items) {
        images.push_back(item.name);
    }
    std::ranges::sort(images);
    std::vector<fs::path> found;
    std::error_code problem;
    std::error_code ignored; // a link that leads nowhere is no regular file
    for (const auto& entry : fs::directory_iterator(folder, problem)) {
        const std::string name = entry.path().filename().string();
        if (entry.is_regular_file(ignored) && name != list_name && !name.starts_with('.') &&
            !std::ranges::binary_search(images, name) && holds_events(entry.path())) {
            found.push_back(entry.path());
        }
    }
    if (problem) {
        throw system_error(problem.value(), folder, "cannot list");
    }
    if (found.empty()) {
        fail(folder, "no events file in the recording", "add the recording's events");
    }
    if (found.size() > 1) {
        std::ranges::sort(found);
        std::string names;
        for (const auto& path : found) {
            names += (names.empty() ? "" : ", ") + path.filename().string();
        }
        fail(folder, "several events files in the recording: " + names, "leave one of them");
    }
    return found.front();
}

} // namespace

std::string Recording::full_name(const Item& item) const {
    return frames ? place.string() + ", " + item.name : (place / item.name).string();
}

Image Recording::read(const Item& item) const {
    return frames ? frames->read(item.frame) : read_image(place / item.name);
}

bool is_camera_file(const fs::path& path) {
    constexpr size_t enough = 16;
    return is_aedat4(read_start(path, enough)) && aedat4_holds_frames(path);
}

Recording open_recording(const fs::path& path) {
    std::error_code problem;
    if (fs::is_regular_file(path, problem) && is_camera_file(path)) {
        return open_aedat4_recording(path);
    }
    if (!fs::is_directory(path, problem)) {
        fail(path, "not a recording",
             "give a folder with exposures.csv, images and events, or an AEDAT 4 file");
    }
    const fs::path list = path / list_name;
    if (!fs::exists(list, problem)) {
        fail(path, "has no exposures.csv",
             "add one with the columns `" + std::string(header) + "`");
    }
    const auto bytes = read_file(list);
    Recording recording;
    recording.items =
        ListParser(path).parse({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    recording.events = find_events(path, recording.items);
    recording.place = path;
    return recording;
}

} // namespace ecir::io
