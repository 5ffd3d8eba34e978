#pragma once
#include <cstdint>
#include <span>

#include "layers/events.hpp"

namespace ecir::io {

// Decoders of the words of Prophesee's formats, little-endian, as the vendor describes them. Each
// is a small state, to be kept with a place in a file, and a function that takes whole words and
// appends their events; times are microseconds since the camera's start, turned round counters
// counted on. What comes before a first time is passed over, so are triggers and what else is no
// event. Of EVT so are high bits of the time that go back a little, which cameras are said to send
// now and then.

/// A counter of `Bits` bits that turns round.
template <unsigned Bits> class TurningTime {
public:
    [[nodiscard]] bool known() const { return known_; }
    /// In counts, with those of all turns so far.
    [[nodiscard]] int64_t value() const { return turns_ + last_; }
    /// Whether a counter is of a little before; by half a turn or more it has turned round.
    [[nodiscard]] bool passed(uint32_t counter) const {
        return known_ && counter < last_ && last_ - counter < range / 2;
    }
    void set(uint32_t counter) {
        turns_ += known_ && counter < last_ && !passed(counter) ? range : 0;
        last_ = counter;
        known_ = true;
    }

private:
    static constexpr int64_t range = int64_t{1} << Bits;
    int64_t turns_ = 0;
    int64_t last_ = 0;
    bool known_ = false;
};

/// EVT 2.0: an event a word of 32 bits, with the low 6 bits of its time.
class Evt2Words {
public:
    static constexpr size_t word = 4; ///< bytes
    void decode(std::span<const uint8_t> words, Events& out);

private:
    TurningTime<28> high_;
};

/// EVT 2.1: words of 64 bits for 32 neighbours of a row, one bit each. Swapped: the halves of each
/// word the other way round ("legacy" of the IMX636).
template <bool Swapped> class Evt21Words {
public:
    static constexpr size_t word = 8;
    void decode(std::span<const uint8_t> words, Events& out);

private:
    TurningTime<28> high_;
};

/// EVT 3.0: words of 16 bits that change row, column or time, or give the events of up to 12
/// neighbours.
class Evt3Words {
public:
    static constexpr size_t word = 2;
    void decode(std::span<const uint8_t> words, Events& out);

private:
    void vector(uint32_t valid, uint16_t length, Events& out);

    TurningTime<12> high_;
    int64_t time_ = 0;
    uint16_t x_ = 0; ///< where the next vector begins
    uint16_t y_ = 0;
    uint8_t positive_ = 0; ///< of vectors
    bool row_known_ = false;
};

/// DAT: 32 bits of time, then column, row and sign.
class DatWords {
public:
    static constexpr size_t word = 8;
    void decode(std::span<const uint8_t> words, Events& out);

private:
    TurningTime<32> time_;
};

} // namespace ecir::io
