#include "tools/io/decimal.hpp"

#include <limits>

namespace ecir::io {
namespace {

bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

} // namespace

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

Fit to_integer(const Decimal& number, int scale, int64_t most, int64_t& value) {
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
    if (whole > static_cast<uint64_t>(most)) {
        return Fit::too_large;
    }
    value = number.negative ? -static_cast<int64_t>(whole) : static_cast<int64_t>(whole);
    return exact ? Fit::exact : Fit::rounded;
}

} // namespace ecir::io
