#include "tools/io/event_windows.hpp"

#include <algorithm>
#include <limits>
#include <new>
#include <string>

#include "runtime/error.hpp"
#include "tools/io/event_formats.hpp"

namespace ecir::io {
namespace {

template <class T> void drop_front(std::vector<T>& values, size_t count) {
    values.erase(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(count));
}

} // namespace

EventWindows::EventWindows(const std::filesystem::path& path, Reading reading)
    : path_(path), reading_(reading), stream_(open_events(path)), span_(stream_->span()),
      from_(std::numeric_limits<int64_t>::min()) {}

EventWindows::~EventWindows() = default;

std::optional<int> EventWindows::width() const {
    return stream_->width();
}
std::optional<int> EventWindows::height() const {
    return stream_->height();
}

EventWindows::Window EventWindows::read(const Exposure& exposure) {
    try {
        fetch(exposure);
    } catch (const std::bad_alloc&) {
        throw Error(ExitCode::resources,
                    path_.string() + ": not enough memory for the events from " +
                        std::to_string(exposure.start) + " to " + std::to_string(exposure.end) +
                        " us; free some, or give shorter exposures");
    }
    const EventView events = window(kept_.view(), exposure);
    return {events, first_ + static_cast<size_t>(events.t.data() - kept_.t.data())};
}

void EventWindows::fetch(const Exposure& exposure) {
    const bool ahead = kept_.size() == 0 || kept_.t.back() < exposure.start;
    if (ahead || exposure.start < from_) {
        if (reading_ == Reading::sparse) {
            stream_->jump(exposure.start);
        } else {
            stream_->seek(exposure.start);
        }
        drop_before(std::numeric_limits<int64_t>::max());
        from_ = exposure.start;
    }
    do {
        if (kept_.size() > 0 && kept_.t.back() > exposure.end) {
            return;
        }
        drop_before(exposure.start);
    } while (stream_->read(kept_));
}

void EventWindows::drop_before(int64_t time) {
    const auto count =
        static_cast<size_t>(std::ranges::lower_bound(kept_.t, time) - kept_.t.begin());
    drop_front(kept_.t, count);
    drop_front(kept_.x, count);
    drop_front(kept_.y, count);
    drop_front(kept_.p, count);
    first_ = stream_->position() - kept_.size();
    from_ = std::max(from_, time);
}

void EventWindows::finish() {
    if (reading_ == Reading::whole) {
        stream_->finish();
    }
}

} // namespace ecir::io
