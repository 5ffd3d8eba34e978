#pragma once
#include <cstdint>
#include <string_view>

namespace ecir::io {

/// A decimal number as it is written: (-1)^negative x digits x 10^exponent, `rest` if nonzero
/// digits did not fit. Kept in integers, since a double has no microseconds left at 1e10 seconds.
struct Decimal {
    bool negative = false;
    bool rest = false;
    uint64_t digits = 0;
    int exponent = 0;
};

/// Parses all of `word`; false if it is not a finite decimal number.
bool parse_decimal(std::string_view word, Decimal& number);

enum class Fit { exact, rounded, too_large };

/// number x 10^scale to the nearest integer, halves away from zero; too_large beyond `most` either
/// way.
Fit to_integer(const Decimal& number, int scale, int64_t most, int64_t& value);

} // namespace ecir::io
