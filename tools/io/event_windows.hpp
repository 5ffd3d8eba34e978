#pragma once
#include <filesystem>
#include <memory>
#include <optional>

#include "tools/io/event_file.hpp"

namespace ecir::io {

class EventStream;

/// The events of one exposure after another, out of a file that need not fit into memory: what is
/// held is one exposure's events and a block of the file (a megabyte of it, a packet, or a chunk of
/// HDF5). Exposures may overlap and come in any order; ascending ones read the file once.
///
/// Checks, as for read_events(): of the events of an exposure, and of those in the same block,
/// everything. Between exposures and behind the last one the order of the times alone (text:
/// everything), so that an unsorted file is an error wherever its times go back. Damage far into a
/// file is found when it is reached.
class EventWindows {
public:
    enum class Reading {
        whole,  ///< the file from its start on; finish() passes over the rest
        sparse, ///< only what read() asks for; HDF5 is searched for it, in which the times that the
                ///< search meets must be in order
    };
    /// Reads nothing but the sensor's size and the times at both ends. Errors as for read_events(),
    /// unsorted times among them if the last time comes before the first.
    explicit EventWindows(const std::filesystem::path& path, Reading reading = Reading::whole);
    ~EventWindows();
    EventWindows(const EventWindows&) = delete;
    EventWindows& operator=(const EventWindows&) = delete;

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Of the sensor, where the file states it.
    [[nodiscard]] std::optional<int> width() const;
    [[nodiscard]] std::optional<int> height() const;
    /// From the first event to the last; none where there are no events.
    [[nodiscard]] const std::optional<TimeSpan>& span() const { return span_; }

    struct Window {
        EventView events; ///< valid until the next call
        size_t first = 0; ///< number in the file of the first of them
    };
    /// The events with exposure.start <= t <= exposure.end. Errors as for read_events(), and
    /// Error(resources) where they do not fit into memory.
    Window read(const Exposure& exposure);

    /// Checks what no exposure has asked for yet, with Reading::whole.
    void finish();

private:
    void fetch(const Exposure& exposure);
    void drop_before(int64_t time);

    std::filesystem::path path_;
    Reading reading_;
    std::unique_ptr<EventStream> stream_;
    std::optional<TimeSpan> span_;
    Events kept_;      ///< all events from the time `from_` on, up to where the stream is
    size_t first_ = 0; ///< number in the file of kept_'s first
    int64_t from_;
};

} // namespace ecir::io
