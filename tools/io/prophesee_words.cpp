#include "tools/io/prophesee_words.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

namespace ecir::io {
namespace {

static_assert(std::endian::native == std::endian::little, "words are taken as they are stored");

template <class Word> Word load(const uint8_t* at) {
    Word word = 0;
    std::memcpy(&word, at, sizeof(word));
    return word;
}

uint32_t bits(uint64_t word, unsigned first, unsigned count) {
    return static_cast<uint32_t>(word >> first) & ((1U << count) - 1);
}

template <unsigned Bits> void advance(TurningTime<Bits>& time, uint32_t counter) {
    if (!time.passed(counter)) {
        time.set(counter);
    }
}

uint16_t coordinate(uint64_t word, unsigned first) {
    return static_cast<uint16_t>(bits(word, first, 11));
}

// Of EVT 2.0 and 2.1, in a word's highest 4 bits.
constexpr uint32_t type_off = 0x0;
constexpr uint32_t type_on = 0x1;
constexpr uint32_t type_time = 0x8;

} // namespace

void Evt2Words::decode(std::span<const uint8_t> words, Events& out) {
    for (size_t at = 0; at + word <= words.size(); at += word) {
        const auto value = load<uint32_t>(words.data() + at);
        const uint32_t type = bits(value, 28, 4);
        if (type == type_time) {
            advance(high_, bits(value, 0, 28));
        } else if ((type == type_off || type == type_on) && high_.known()) {
            out.push_back(high_.value() * 64 + bits(value, 22, 6), coordinate(value, 11),
                          coordinate(value, 0), static_cast<uint8_t>(type));
        }
    }
}

template <bool Swapped>
void Evt21Words<Swapped>::decode(std::span<const uint8_t> words, Events& out) {
    for (size_t at = 0; at + word <= words.size(); at += word) {
        auto value = load<uint64_t>(words.data() + at);
        value = Swapped ? std::rotl(value, 32) : value;
        const uint32_t type = bits(value, 60, 4);
        if (type == type_time) {
            advance(high_, bits(value, 32, 28));
        } else if ((type == type_off || type == type_on) && high_.known()) {
            const int64_t time = high_.value() * 64 + bits(value, 54, 6);
            const uint16_t x = coordinate(value, 43);
            for (auto valid = static_cast<uint32_t>(value); valid != 0; valid &= valid - 1) {
                out.push_back(time, static_cast<uint16_t>(x + std::countr_zero(valid)),
                              coordinate(value, 32), static_cast<uint8_t>(type));
            }
        }
    }
}
template class Evt21Words<false>;
template class Evt21Words<true>;

void Evt3Words::decode(std::span<const uint8_t> words, Events& out) {
    for (size_t at = 0; at + word <= words.size(); at += word) {
        const auto value = load<uint16_t>(words.data() + at);
        switch (value >> 12) {
        case 0x0: // row
            y_ = coordinate(value, 0);
            row_known_ = true;
            break;
        case 0x2: // event; the vectors' place stays where it is
            if (high_.known() && row_known_) {
                out.push_back(time_, coordinate(value, 0), y_,
                              static_cast<uint8_t>(bits(value, 11, 1)));
            }
            break;
        case 0x3: // where vectors begin
            x_ = coordinate(value, 0);
            positive_ = static_cast<uint8_t>(bits(value, 11, 1));
            break;
        case 0x4:
            vector(bits(value, 0, 12), 12, out);
            break;
        case 0x5:
            vector(bits(value, 0, 8), 8, out);
            break;
        case 0x6: // low 12 bits of the time
            time_ = high_.value() * 4096 + bits(value, 0, 12);
            break;
        case 0x8: // high 12 bits, said again and again
            advance(high_, bits(value, 0, 12));
            // Low bits that were said before belong to the high bits before.
            time_ = std::max(time_, high_.value() * 4096);
            break;
        default:
            break;
        }
    }
}

void Evt3Words::vector(uint32_t valid, uint16_t length, Events& out) {
    if (high_.known() && row_known_) {
        for (; valid != 0; valid &= valid - 1) {
            out.push_back(time_, static_cast<uint16_t>(x_ + std::countr_zero(valid)), y_,
                          positive_);
        }
    }
    x_ = static_cast<uint16_t>(x_ + length);
}

void DatWords::decode(std::span<const uint8_t> words, Events& out) {
    for (size_t at = 0; at + word <= words.size(); at += word) {
        const auto value = load<uint64_t>(words.data() + at);
        time_.set(static_cast<uint32_t>(value));
        out.push_back(time_.value(), static_cast<uint16_t>(bits(value, 32, 14)),
                      static_cast<uint16_t>(bits(value, 46, 14)),
                      static_cast<uint8_t>(bits(value, 60, 4) != 0));
    }
}

} // namespace ecir::io
