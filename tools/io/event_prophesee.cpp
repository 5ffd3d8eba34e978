#include <algorithm>
#include <array>
#include <charconv>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/error.hpp"
#include "tools/io/event_formats.hpp"
#include "tools/io/file.hpp"
#include "tools/io/marks.hpp"
#include "tools/io/prophesee_words.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

constexpr std::string_view line_start = "% ";

[[noreturn]] void fail(const fs::path& path, const std::string& what, const std::string& remedy) {
    throw Error(ExitCode::bad_input, path.string() + ": " + what + "; " + remedy);
}

/// What stands before the words: lines `% key value`, one of which may be `% format
/// EVT3;width=1280`.
struct Header {
    std::map<std::string, std::string> values; ///< also those within `format`
    int64_t size = 0;                          ///< bytes

    [[nodiscard]] std::string get(const std::string& key) const {
        const auto found = values.find(key);
        return found == values.end() ? std::string() : found->second;
    }
    /// A whole number above 0, such as the sensor's width.
    [[nodiscard]] std::optional<int> positive(const std::string& key) const {
        const std::string text = get(key);
        int number = 0;
        const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), number);
        return problem == std::errc() && end == text.data() + text.size() && number > 0
                   ? std::optional(number)
                   : std::nullopt;
    }
};

void add_format(Header& header, std::string_view text) {
    for (bool name = true; !text.empty(); name = false) {
        const std::string_view part = text.substr(0, text.find(';'));
        text.remove_prefix(std::min(part.size() + 1, text.size()));
        const size_t equals = std::min(part.find('='), part.size());
        if (name) {
            header.values["format"] = part;
        } else {
            header.values[std::string(part.substr(0, equals))] =
                part.substr(std::min(equals + 1, part.size()));
        }
    }
}

void add_line(Header& header, std::string_view line) {
    line.remove_prefix(line_start.size());
    const size_t space = std::min(line.find(' '), line.size());
    const std::string key(line.substr(0, space));
    const std::string_view value = line.substr(std::min(space + 1, line.size()));
    if (key == "format") {
        add_format(header, value);
    } else if (key == "geometry") { // 1280x720
        const size_t cross = std::min(value.find('x'), value.size());
        header.values["width"] = value.substr(0, cross);
        header.values["height"] = value.substr(std::min(cross + 1, value.size()));
    } else if (key == "Width" || key == "Height") { // of DAT
        header.values[key == "Width" ? "width" : "height"] = value;
    } else {
        header.values[key] = value;
    }
}

Header read_header(const FileReader& file) {
    constexpr size_t most = size_t{1} << 16U;
    std::vector<uint8_t> bytes(most);
    bytes.resize(file.read(0, bytes));
    const std::string_view all(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    Header header;
    size_t at = 0;
    while (all.substr(at).starts_with(line_start)) {
        const size_t end = all.find('\n', at);
        if (end == std::string_view::npos) {
            fail(file.path(), "its header does not end", "copy the file again");
        }
        std::string_view line = all.substr(at, end - at);
        line.remove_suffix(line.ends_with('\r') ? 1 : 0);
        at = end + 1;
        if (line == "% end") {
            break;
        }
        add_line(header, line);
    }
    header.size = static_cast<int64_t>(at);
    return header;
}

/// From the header on, words of one kind. An incomplete last word, which a recording leaves that
/// broke off, is passed over.
template <class Words> class PropheseeEvents final : public EventStream {
public:
    PropheseeEvents(const fs::path& path, const Header& header, int64_t begin)
        : file_(path), width_(header.positive("width")), height_(header.positive("height")),
          block_(size_t{1} << 20U) {
        start_.offset = begin;
        place_ = start_;
    }

    bool read(Events& out) override {
        marks_.add(place_);
        const size_t got = file_.read(place_.offset, block_);
        const size_t whole = got - got % Words::word;
        if (whole == 0) {
            return false;
        }
        const size_t had = out.size();
        place_.words.decode(std::span<const uint8_t>(block_).first(whole), out);
        place_.offset += static_cast<int64_t>(whole);
        drop_outside(out, had);
        for (size_t i = had; i < out.size(); ++i) {
            if (out.t[i] < place_.last) {
                fail_unsorted(file_.path(), "event " + std::to_string(place_.events), place_.last,
                              out.t[i]);
            }
            place_.last = out.t[i];
            ++place_.events;
        }
        return true;
    }

    [[nodiscard]] size_t position() const override { return place_.events; }

    void seek(int64_t time) override {
        const Place best = marks_.before(time, start_);
        if (place_.last >= time || place_.offset < best.offset) {
            place_ = best;
        }
    }
    void jump(int64_t time) override { seek(time); }

    void finish() override {
        Events passed;
        while (read(passed)) {
            resize(passed, 0);
        }
    }

    /// By one pass, some 0.5 s for 100 MB: how often the camera's clock turned round shows nowhere
    /// else. Going to an exposure is quick then.
    std::optional<TimeSpan> span() override {
        place_ = start_;
        std::optional<TimeSpan> span;
        Events passed;
        while (read(passed)) {
            if (passed.size() > 0) {
                span = TimeSpan{span ? span->first : passed.t.front(), passed.t.back()};
            }
            resize(passed, 0);
        }
        place_ = start_;
        return span;
    }

    [[nodiscard]] std::optional<int> width() const override { return width_; }
    [[nodiscard]] std::optional<int> height() const override { return height_; }

private:
    struct Place {
        int64_t offset = 0;                                 ///< bytes
        size_t events = 0;                                  ///< before it
        int64_t last = std::numeric_limits<int64_t>::min(); ///< time of the last event before it
        Words words;
    };

    /// Events beyond the sensor's stated size, which are faults of the transmission; the vendor's
    /// own decoder drops them.
    void drop_outside(Events& events, size_t first) const {
        const int width = width_.value_or(std::numeric_limits<int>::max());
        const int height = height_.value_or(std::numeric_limits<int>::max());
        size_t kept = first;
        for (size_t i = first; i < events.size(); ++i) {
            if (events.x[i] < width && events.y[i] < height) {
                events.t[kept] = events.t[i];
                events.x[kept] = events.x[i];
                events.y[kept] = events.y[i];
                events.p[kept] = events.p[i];
                ++kept;
            }
        }
        resize(events, kept);
    }

    /// Keeps what was allocated.
    static void resize(Events& events, size_t count) {
        events.t.resize(count);
        events.x.resize(count);
        events.y.resize(count);
        events.p.resize(count);
    }

    FileReader file_;
    std::optional<int> width_;
    std::optional<int> height_;
    std::vector<uint8_t> block_;
    Place start_;
    Place place_;
    Marks<Place> marks_;
};

/// Systems that wrote EVT 2.1 before headers stated the order of its halves.
bool is_older(const Header& header) {
    constexpr int last_of_them = 54;
    const auto system = header.positive("system_ID");
    return system && *system <= last_of_them;
}

std::unique_ptr<EventStream> open_dat(const FileReader& file, const Header& header) {
    constexpr uint8_t generic = 0;
    constexpr uint8_t contrast = 12;
    std::array<uint8_t, 2> type_and_size{};
    if (header.get("Version") != "2") {
        fail(file.path(), "is DAT of version '" + header.get("Version") + "', not 2",
             "write it again with newer software of the camera");
    }
    if (file.read(header.size, type_and_size) < type_and_size.size()) {
        fail(file.path(), "ends in its header", "copy the file again");
    }
    const auto [type, size] = type_and_size;
    if ((type != generic && type != contrast) || size != DatWords::word) {
        fail(file.path(),
             "holds events of type " + std::to_string(type) + " with " + std::to_string(size) +
                 " bytes, not contrast events (type 0 or 12, 8 bytes)",
             "give the file of the contrast events, often named _cd.dat or _td.dat");
    }
    return std::make_unique<PropheseeEvents<DatWords>>(
        file.path(), header, header.size + static_cast<int64_t>(type_and_size.size()));
}

} // namespace

bool is_prophesee(std::span<const uint8_t> start) {
    return start.size() >= line_start.size() &&
           std::equal(line_start.begin(), line_start.end(), start.begin());
}

std::unique_ptr<EventStream> open_prophesee_events(const fs::path& path) {
    const FileReader file(path);
    const Header header = read_header(file);
    const std::string format = header.get("format");
    const std::string version = header.get("evt");
    const std::string order = header.get("endianness");
    if (!order.empty() && order != "little" && order != "legacy") {
        fail(path, "its header names the byte order '" + order + "', not little or legacy",
             "record it again with the sensor's usual byte order");
    }
    if (format == "EVT2" || (format.empty() && version == "2.0")) {
        return std::make_unique<PropheseeEvents<Evt2Words>>(path, header, header.size);
    }
    if (format == "EVT21" || (format.empty() && version == "2.1")) {
        if (order == "legacy" || (order.empty() && is_older(header))) {
            return std::make_unique<PropheseeEvents<Evt21Words<true>>>(path, header, header.size);
        }
        return std::make_unique<PropheseeEvents<Evt21Words<false>>>(path, header, header.size);
    }
    if (format == "EVT3" || (format.empty() && version == "3.0")) {
        return std::make_unique<PropheseeEvents<Evt3Words>>(path, header, header.size);
    }
    if (format.empty() && version.empty() && !header.get("Version").empty()) {
        return open_dat(file, header);
    }
    fail(path,
         "its header names " +
             (format.empty() && version.empty()
                  ? std::string("no format")
                  : "the format '" + (format.empty() ? version : format) + "'") +
             "; known are EVT 2.0, 2.1 and 3.0, and DAT of version 2",
         "convert it to one of these");
}

} // namespace ecir::io
