#pragma once
#include <cstdint>
#include <vector>

#include "layers/events.hpp"

namespace ecir {

/// Side of the cells in which activity is told, pixels.
inline constexpr uint32_t activity_cell = 16;

/// Which cells of an image something happened in; those at the right and the lower border may be
/// cut.
struct ActivityMap {
    uint32_t columns = 0;
    uint32_t rows = 0;
    std::vector<uint8_t> active; ///< [rows][columns], 0 or 1

    ActivityMap(uint32_t width, uint32_t height)
        : columns((width + activity_cell - 1) / activity_cell),
          rows((height + activity_cell - 1) / activity_cell), active(size_t{columns} * rows) {}
    [[nodiscard]] bool at(uint32_t column, uint32_t row) const {
        return active[size_t{row} * columns + column] != 0;
    }
    /// Share of the cells that are active, 0 to 1.
    [[nodiscard]] double share() const;
};

/// Cells with an event. `events` must lie inside the image.
ActivityMap touched_cells(const EventView& events, uint32_t width, uint32_t height);

/// Cells that something moved in, as far as that can be told from the sensor's noise. Both kinds of
/// events differ in company: an edge makes neighbouring pixels fire shortly after one another,
/// noise and hot pixels fire alone. Counted are the pixels with an event that another one of their
/// 3 x 3 neighbourhood came within a sixteenth of the exposure of; a cell is active where they are
/// more, by 4 and 4 standard deviations, than chance makes of the events of the cell, or of the
/// quietest tenth of the cells if those are fewer. Of its neighbours those are active, too, that
/// have half as many more. A cell with events at 60 % of its pixels always is, since no noise makes
/// so many.
///
/// `events` must be sorted by time and lie inside the image and the exposure.
ActivityMap moving_cells(const EventView& events, const Exposure& exposure, uint32_t width,
                         uint32_t height);

} // namespace ecir
