#include <algorithm>
#include <string>
#include <vector>

#include "aedat4_generated.h"
#include "runtime/error.hpp"
#include "tools/io/aedat4.hpp"
#include "tools/io/event_formats.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

using Packet = Aedat4Stream::Packet;

/// Packet by packet. The order of the times between packets is checked by the file's table at once.
class Aedat4Events final : public EventStream {
public:
    explicit Aedat4Events(const fs::path& path)
        : stream_(path, Aedat4Stream::Kind::events), packets_(stream_.packets()) {
        if (!stream_.found()) {
            throw Error(ExitCode::bad_input, path.string() + ": holds no events; record them with "
                                                             "the camera's software");
        }
        before_.reserve(packets_.size() + 1);
        before_.push_back(0);
        int64_t last = -max_event_time;
        for (const Packet& packet : packets_) {
            const size_t event = before_.back();
            check_order(event, last, packet.first_time);
            check_order(event, packet.first_time, packet.last_time);
            last = packet.last_time;
            if (last > max_event_time) {
                stream_.fail(packet, "has times too large for microseconds");
            }
            before_.push_back(event + static_cast<size_t>(packet.elements));
        }
    }

    bool read(Events& out) override {
        if (next_ == packets_.size()) {
            return false;
        }
        const Packet& packet = packets_[next_];
        const auto* events =
            flatbuffers::GetSizePrefixedRoot<aedat4::EventPacket>(stream_.unpack(packet).data())
                ->events();
        // What the file's table says of a packet was relied on to find it.
        if (events == nullptr || events->size() != static_cast<uint64_t>(packet.elements) ||
            events->Get(0)->time() != packet.first_time ||
            events->Get(events->size() - 1)->time() != packet.last_time) {
            stream_.fail(packet, "does not hold what the file's table says");
        }
        size_t event = before_[next_];
        int64_t before = packet.first_time;
        for (const auto* one : *events) {
            check_order(event, before, one->time());
            if (one->x() < 0 || one->y() < 0) {
                stream_.fail(packet, "has a negative coordinate in event " + std::to_string(event));
            }
            before = one->time();
            out.push_back(before, static_cast<uint16_t>(one->x()), static_cast<uint16_t>(one->y()),
                          one->positive() ? 1 : 0);
            ++event;
        }
        ++next_;
        return true;
    }

    [[nodiscard]] size_t position() const override { return before_[next_]; }

    void seek(int64_t time) override {
        const auto found = std::ranges::lower_bound(packets_, time, {}, &Packet::last_time);
        next_ = static_cast<size_t>(found - packets_.begin());
    }
    void jump(int64_t time) override { seek(time); }
    void finish() override {}

    std::optional<TimeSpan> span() override {
        if (packets_.empty()) {
            return std::nullopt;
        }
        return TimeSpan{packets_.front().first_time, packets_.back().last_time};
    }

private:
    void check_order(size_t event, int64_t before, int64_t time) const {
        if (time < before) {
            fail_unsorted(stream_.path(), "event " + std::to_string(event), before, time);
        }
    }

    Aedat4Stream stream_;
    const std::vector<Packet>& packets_;
    std::vector<size_t> before_; ///< events before each packet, and in all
    size_t next_ = 0;
};

} // namespace

std::unique_ptr<EventStream> open_aedat4_events(const fs::path& path) {
    return std::make_unique<Aedat4Events>(path);
}

} // namespace ecir::io
