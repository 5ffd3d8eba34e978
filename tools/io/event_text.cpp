#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/error.hpp"
#include "tools/io/decimal.hpp"
#include "tools/io/event_formats.hpp"
#include "tools/io/file.hpp"
#include "tools/io/marks.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

constexpr int max_coordinate = std::numeric_limits<uint16_t>::max();
constexpr const char* line_form = "a line is `t x y p`: seconds, column, row, 0 or 1";

constexpr size_t max_words = 5; // one more than a line may have

/// Splits at blanks; returns how many words there are, at most max_words.
size_t split(std::string_view line, std::array<std::string_view, max_words>& words) {
    size_t count = 0;
    const char* at = line.data();
    const char* const end = at + line.size();
    const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
    while (count < max_words) {
        while (at != end && blank(*at)) {
            ++at;
        }
        if (at == end) {
            break;
        }
        const char* const first = at;
        while (at != end && !blank(*at)) {
            ++at;
        }
        words[count++] = {first, static_cast<size_t>(at - first)};
    }
    return count;
}

/// Where a line begins, and what the lines before it decide.
struct Place {
    long offset = 0;                                    ///< bytes
    size_t lines = 0;                                   ///< before it
    size_t events = 0;                                  ///< before it
    int64_t last = std::numeric_limits<int64_t>::min(); ///< time of the last event before it
    int64_t negative = 1; ///< what stands for darker, 0 or -1; 1 while unknown
    bool first = true;    ///< whether the sensor's size may come
};

/// Takes line after line.
class TextParser {
public:
    explicit TextParser(const fs::path& path) : path_(path) {}

    [[nodiscard]] const Place& place() const { return place_; }
    void go(const Place& place) { place_ = place; }
    [[nodiscard]] std::optional<int> width() const { return width_; }
    [[nodiscard]] std::optional<int> height() const { return height_; }

    /// `bytes`: of the line with its end. An event goes to `out`.
    void line(std::string_view text, size_t bytes, Events& out) {
        ++place_.lines;
        std::array<std::string_view, max_words> words;
        const size_t count = split(text, words);
        place_.offset += static_cast<long>(bytes);
        if (count == 0 || words[0].starts_with('#')) {
            return;
        }
        if (count == 2 && place_.first) {
            width_ = static_cast<int>(integer(words[0], "width", 1, max_coordinate + 1));
            height_ = static_cast<int>(integer(words[1], "height", 1, max_coordinate + 1));
        } else if (count == 4) {
            event(words, out);
        } else {
            fail("has " + std::string(count == max_words ? "more than 4" : std::to_string(count)) +
                     (count == 1 ? " column" : " columns"),
                 line_form);
        }
        place_.first = false;
    }

    [[noreturn]] void fail(const std::string& what, const std::string& remedy) const {
        throw Error(ExitCode::bad_input, path_.string() + ": line " + std::to_string(place_.lines) +
                                             " " + what + "; " + remedy);
    }

private:
    void event(const std::array<std::string_view, max_words>& words, Events& out) {
        const int64_t t = time(words[0]);
        const int64_t x = integer(words[1], "x", 0, max_coordinate);
        const int64_t y = integer(words[2], "y", 0, max_coordinate);
        const int64_t p = integer(words[3], "polarity", -1, 1);
        if (p != 1) {
            if (place_.negative != 1 && place_.negative != p) {
                fail("has polarity " + std::to_string(p) + ", a line before it had " +
                         std::to_string(place_.negative),
                     "use either 0 and 1 or -1 and 1");
            }
            place_.negative = p;
        }
        if (t < place_.last) {
            fail_unsorted(path_, "line " + std::to_string(place_.lines), place_.last, t);
        }
        out.push_back(t, static_cast<uint16_t>(x), static_cast<uint16_t>(y), p == 1 ? 1 : 0);
        place_.last = t;
        ++place_.events;
    }

    [[nodiscard]] int64_t time(std::string_view word) const {
        Decimal number;
        int64_t microseconds = 0;
        if (!parse_decimal(word, number)) {
            fail("has the time '" + shown(word) + "', which is not a finite number", line_form);
        }
        if (to_integer(number, 6, max_event_time, microseconds) == Fit::too_large) {
            fail("has the time '" + shown(word) + "', which is too large",
                 "times are in seconds, not in smaller units");
        }
        return microseconds;
    }

    int64_t integer(std::string_view word, const char* name, int64_t least, int64_t most) const {
        Decimal number;
        int64_t value = 0;
        if (!parse_decimal(word, number)) {
            fail("has the " + std::string(name) + " '" + shown(word) +
                     "', which is not a finite number",
                 line_form);
        }
        if (to_integer(number, 0, max_event_time, value) != Fit::exact || value < least ||
            value > most) {
            fail("has the " + std::string(name) + " '" + shown(word) +
                     "', which is not an integer from " + std::to_string(least) + " to " +
                     std::to_string(most),
                 line_form);
        }
        return value;
    }

    /// Short enough for a message, without bytes that a terminal would act on.
    static std::string shown(std::string_view word) {
        std::string text(word.substr(0, 40));
        for (char& c : text) {
            c = c < ' ' || c > '~' ? '?' : c;
        }
        return text;
    }

    const fs::path& path_;
    Place place_;
    std::optional<int> width_;
    std::optional<int> height_;
};

/// The time of the last line that is an event's, if there is one.
std::optional<int64_t> last_time(std::string_view text) {
    while (!text.empty()) {
        const size_t newline = text.substr(0, text.size() - 1).rfind('\n');
        const size_t start = newline == std::string_view::npos ? 0 : newline + 1;
        std::array<std::string_view, max_words> words;
        Decimal number;
        int64_t time = 0;
        if (split(text.substr(start, text.find('\n', start) - start), words) == 4 &&
            parse_decimal(words[0], number) &&
            to_integer(number, 6, max_event_time, time) != Fit::too_large) {
            return time;
        }
        text = text.substr(0, start);
    }
    return std::nullopt;
}

class TextEvents final : public EventStream {
public:
    explicit TextEvents(fs::path path)
        : path_(std::move(path)), file_(std::fopen(path_.c_str(), "rbe")), parser_(path_),
          block_(size_t{1} << 20U) {
        if (!file_) {
            throw system_error(errno, path_, "cannot open");
        }
        // On to the first event, before which the sensor's size would stand.
        Events events;
        while (events.size() == 0 && read(events)) {
        }
        if (parser_.place().lines == 0) {
            throw Error(ExitCode::bad_input,
                        path_.string() + ": the file is empty; copy or record it again");
        }
        if (events.size() > 0) {
            first_ = events.t.front();
        }
        go({});
    }

    bool read(Events& out) override {
        if (ended_) {
            return false;
        }
        marks_.add(parser_.place());
        const size_t got = std::fread(block_.data() + kept_, 1, block_.size() - kept_, file_.get());
        ended_ = got == 0;
        if (ended_ && std::ferror(file_.get()) != 0) {
            throw system_error(errno, path_, "cannot read");
        }
        std::string_view rest(block_.data(), kept_ + got);
        for (size_t end = 0; (end = rest.find('\n')) != std::string_view::npos;) {
            parser_.line(rest.substr(0, end), end + 1, out);
            rest.remove_prefix(end + 1);
        }
        if (ended_ && !rest.empty()) {
            parser_.line(rest, rest.size(), out);
            rest = {};
        } else if (rest.size() == block_.size()) {
            parser_.fail("is followed by one of more than a million characters", line_form);
        }
        // A line that the block ends in is moved to the front.
        kept_ = rest.size();
        if (kept_ > 0) {
            std::memmove(block_.data(), rest.data(), kept_);
        }
        return !ended_;
    }

    [[nodiscard]] size_t position() const override { return parser_.place().events; }

    void seek(int64_t time) override {
        const Place best = marks_.before(time, {});
        if (parser_.place().last >= time || parser_.place().offset < best.offset) {
            go(best);
        }
    }

    void jump(int64_t time) override { seek(time); }

    void finish() override {
        Events passed;
        while (read(passed)) {
            passed = {};
        }
    }

    std::optional<TimeSpan> span() override {
        if (!first_) {
            return std::nullopt;
        }
        std::optional<int64_t> last = last_time(tail());
        go({});
        if (!last || *last < *first_) {
            finish(); // finds the last event, or the first place where times go back
            last = parser_.place().last;
        }
        go({});
        return TimeSpan{*first_, *last};
    }

    [[nodiscard]] std::optional<int> width() const override { return parser_.width(); }
    [[nodiscard]] std::optional<int> height() const override { return parser_.height(); }

private:
    struct Close {
        void operator()(std::FILE* file) const { (void)std::fclose(file); }
    };

    void go(const Place& place) {
        if (std::fseek(file_.get(), place.offset, SEEK_SET) != 0) {
            throw system_error(errno, path_, "cannot read");
        }
        parser_.go(place);
        kept_ = 0;
        ended_ = false;
    }

    /// The file's last bytes, from a line's start on where there is one.
    std::string tail() {
        constexpr long most = 1L << 16U;
        if (std::fseek(file_.get(), 0, SEEK_END) != 0) {
            throw system_error(errno, path_, "cannot read");
        }
        const long size = std::ftell(file_.get());
        const long start = std::max(size - most, 0L);
        std::string text(static_cast<size_t>(size - start), '\0');
        if (std::fseek(file_.get(), start, SEEK_SET) != 0 ||
            std::fread(text.data(), 1, text.size(), file_.get()) != text.size()) {
            throw system_error(errno, path_, "cannot read");
        }
        return start == 0 ? text : text.substr(std::min(text.find('\n'), text.size()));
    }

    fs::path path_;
    std::unique_ptr<std::FILE, Close> file_;
    TextParser parser_;
    std::vector<char> block_;
    size_t kept_ = 0; ///< bytes at the block's front that were read but not parsed
    bool ended_ = false;
    std::optional<int64_t> first_;
    Marks<Place> marks_;
};

} // namespace

bool text_holds_events(std::span<const uint8_t> start) {
    std::string_view text(reinterpret_cast<const char*>(start.data()), start.size());
    while (!text.empty()) {
        const size_t length = std::min(text.find('\n'), text.size());
        std::array<std::string_view, max_words> words;
        const size_t count = split(text.substr(0, length), words);
        if (count != 0 && !words[0].starts_with('#')) {
            bool numbers = count == 2 || count == 4;
            for (size_t i = 0; numbers && i < count; ++i) {
                Decimal number;
                numbers = parse_decimal(words[i], number);
            }
            return numbers;
        }
        text.remove_prefix(std::min(length + 1, text.size()));
    }
    return false;
}

std::unique_ptr<EventStream> open_text_events(const fs::path& path) {
    return std::make_unique<TextEvents>(path);
}

} // namespace ecir::io
