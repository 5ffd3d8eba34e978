#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/error.hpp"
#include "tools/io/event_formats.hpp"
#include "tools/io/file.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

constexpr int max_coordinate = std::numeric_limits<uint16_t>::max();
constexpr const char* line_form = "a line is `t x y p`: seconds, column, row, 0 or 1";

bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

/// A decimal number as it is written: (-1)^negative x digits x 10^exponent, `rest` if nonzero
/// digits did not fit. Kept in integers, since a double has no microseconds left at 1e10 seconds.
struct Decimal {
    bool negative = false;
    bool rest = false;
    uint64_t digits = 0;
    int exponent = 0;
};

/// Parses all of `word`; false if it is not a finite decimal number.
bool parse_decimal(std::string_view word, Decimal& number) {
    constexpr uint64_t room = (std::numeric_limits<uint64_t>::max() - 9) / 10;
    const char* at = word.data();
    const char* const end = at + word.size();
    number.negative = at != end && *at == '-';
    at += at != end && (*at == '-' || *at == '+') ? 1 : 0;
    bool any = false;
    int point = 0; // 1 behind the decimal point
    for (; at != end && (is_digit(*at) || (*at == '.' && point == 0)); ++at) {
        if (*at == '.') {
            point = 1;
            continue;
        }
        any = true;
        const auto digit = static_cast<uint64_t>(*at - '0');
        if (number.digits <= room) {
            number.digits = number.digits * 10 + digit;
            number.exponent -= point;
        } else {
            number.rest = number.rest || digit != 0;
            number.exponent += 1 - point;
        }
    }
    if (any && at != end && (*at == 'e' || *at == 'E')) {
        ++at;
        const bool down = at != end && *at == '-';
        at += at != end && (*at == '-' || *at == '+') ? 1 : 0;
        any = at != end;
        int exponent = 0;
        for (; at != end && is_digit(*at); ++at) {
            exponent = exponent < 10000 ? exponent * 10 + (*at - '0') : exponent;
        }
        number.exponent += down ? -exponent : exponent;
    }
    return any && at == end;
}

enum class Fit { exact, rounded, too_large };

/// number x 10^scale to the nearest integer, halves away from zero.
Fit to_integer(const Decimal& number, int scale, int64_t& value) {
    int shift = number.exponent + scale;
    uint64_t whole = number.digits;
    bool exact = !number.rest;
    if (whole == 0) {
        shift = 0;
    }
    for (; shift > 0; --shift) {
        if (__builtin_mul_overflow(whole, uint64_t{10}, &whole)) {
            return Fit::too_large;
        }
    }
    if (shift < -19) { // less than the 20 digits there can be
        exact = whole == 0;
        whole = 0;
    } else if (shift < 0) {
        uint64_t divisor = 1;
        for (; shift < 0; ++shift) {
            divisor *= 10;
        }
        const uint64_t left = whole % divisor;
        whole /= divisor;
        exact = exact && left == 0;
        whole += left >= divisor - left ? 1 : 0;
    }
    if (whole > static_cast<uint64_t>(max_event_time)) {
        return Fit::too_large;
    }
    value = number.negative ? -static_cast<int64_t>(whole) : static_cast<int64_t>(whole);
    return exact ? Fit::exact : Fit::rounded;
}

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

class TextParser {
public:
    explicit TextParser(const fs::path& path) : path_(path) {}

    void line(std::string_view text) {
        ++number_;
        std::array<std::string_view, max_words> words;
        const size_t count = split(text, words);
        if (count == 0 || words[0].starts_with('#')) {
            return;
        }
        if (count == 2 && first_) {
            file_.width = static_cast<int>(integer(words[0], "width", 1, max_coordinate + 1));
            file_.height = static_cast<int>(integer(words[1], "height", 1, max_coordinate + 1));
        } else if (count == 4) {
            event(words);
        } else {
            fail("has " + std::string(count == max_words ? "more than 4" : std::to_string(count)) +
                     (count == 1 ? " column" : " columns"),
                 line_form);
        }
        first_ = false;
    }

    EventFile take() { return std::move(file_); }

    [[noreturn]] void fail(const std::string& what, const std::string& remedy) const {
        throw Error(ExitCode::bad_input, path_.string() + ": line " + std::to_string(number_) +
                                             " " + what + "; " + remedy);
    }

private:
    void event(const std::array<std::string_view, max_words>& words) {
        const int64_t t = time(words[0]);
        const int64_t x = integer(words[1], "x", 0, max_coordinate);
        const int64_t y = integer(words[2], "y", 0, max_coordinate);
        const int64_t p = integer(words[3], "polarity", -1, 1);
        if (p != 1) {
            if (negative_ != 1 && negative_ != p) {
                fail("has polarity " + std::to_string(p) + ", a line before it had " +
                         std::to_string(negative_),
                     "use either 0 and 1 or -1 and 1");
            }
            negative_ = p;
        }
        if (file_.events.size() > 0 && t < file_.events.t.back()) {
            fail_unsorted(path_, "line " + std::to_string(number_), file_.events.t.back(), t);
        }
        file_.events.push_back(t, static_cast<uint16_t>(x), static_cast<uint16_t>(y),
                               p == 1 ? 1 : 0);
    }

    int64_t time(std::string_view word) const {
        Decimal number;
        int64_t microseconds = 0;
        if (!parse_decimal(word, number)) {
            fail("has the time '" + shown(word) + "', which is not a finite number", line_form);
        }
        if (to_integer(number, 6, microseconds) == Fit::too_large) {
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
        if (to_integer(number, 0, value) != Fit::exact || value < least || value > most) {
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
    EventFile file_;
    size_t number_ = 0;
    bool first_ = true;
    int64_t negative_ = 1; ///< what stands for darker, 0 or -1; 1 while unknown
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

EventFile read_text_events(const fs::path& path) {
    struct Close {
        void operator()(std::FILE* file) const { (void)std::fclose(file); }
    };
    const std::unique_ptr<std::FILE, Close> file(std::fopen(path.c_str(), "rbe"));
    if (!file) {
        throw system_error(errno, path, "cannot open");
    }
    TextParser parser(path);
    // Read in blocks, so that only the events themselves take memory; a line that a block ends in
    // is moved to the front.
    std::vector<char> block(size_t{1} << 20U);
    size_t kept = 0;
    for (bool more = true; more;) {
        const size_t got = std::fread(block.data() + kept, 1, block.size() - kept, file.get());
        more = got != 0;
        if (!more && std::ferror(file.get()) != 0) {
            throw system_error(errno, path, "cannot read");
        }
        std::string_view rest(block.data(), kept + got);
        for (size_t end = 0; (end = rest.find('\n')) != std::string_view::npos;) {
            parser.line(rest.substr(0, end));
            rest.remove_prefix(end + 1);
        }
        if (!more && !rest.empty()) {
            parser.line(rest);
        } else if (rest.size() == block.size()) {
            parser.fail("is followed by one of more than a million characters", line_form);
        }
        kept = rest.size();
        std::memmove(block.data(), rest.data(), kept);
    }
    if (std::ftell(file.get()) == 0) {
        throw Error(ExitCode::bad_input,
                    path.string() + ": the file is empty; copy or record it again");
    }
    return parser.take();
}

} // namespace ecir::io
