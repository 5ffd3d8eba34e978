#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "runtime/error.hpp"
#include "tools/io/event_formats.hpp"
#include "tools/io/hdf5.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

constexpr const char* layout_remedy =
    "store /events/t (integer microseconds), x, y and p (0 or 1), as DSEC does";

[[noreturn]] void fail(const fs::path& path, const std::string& what, const std::string& remedy) {
    throw Error(ExitCode::bad_input, path.string() + ": " + what + "; " + remedy);
}

bool has(const Id& file, const std::string& group, const char* name) {
    return H5Lexists(file.get(), group.c_str(), H5P_DEFAULT) > 0 &&
           H5Lexists(file.get(), (group + "/" + name).c_str(), H5P_DEFAULT) > 0;
}

std::optional<std::string> find_group(const Id& file) {
    for (const char* group : {"/events", "/raw_events"}) {
        if (has(file, group, "t")) {
            return group;
        }
    }
    return std::nullopt;
}

Id open_checked(const fs::path& path) {
    Id file = open_hdf5(path);
    if (!file.valid()) {
        fail(path, "HDF5 cannot open it: truncated or damaged", "copy the file again");
    }
    return file;
}

std::string group_of(const fs::path& path, const Id& file) {
    const auto group = find_group(file);
    if (!group) {
        fail(path, "has no /events/t", layout_remedy);
    }
    return *group;
}

int64_t read_offset(const fs::path& path, const Id& file) {
    if (H5Lexists(file.get(), "/t_offset", H5P_DEFAULT) <= 0) {
        return 0;
    }
    const Column column(path, file, "/t_offset", layout_remedy);
    if (column.size() != 1 || !column.integral()) {
        column.fail("is not a single integer", "store it as one integer of microseconds");
    }
    int64_t offset = 0;
    column.read(0, std::span(&offset, 1));
    if (offset > max_event_time || offset < -max_event_time) {
        column.fail("is too large", "store it as one integer of microseconds");
    }
    return offset;
}

/// Whole blocks of chunks are read at a time. Of the blocks passed so far the first times are kept,
/// so that going back needs no search through the file.
class Hdf5Events final : public EventStream {
public:
    explicit Hdf5Events(const fs::path& path)
        : path_(path), file_(open_checked(path)), group_(group_of(path, file_)), t_(column("/t")),
          x_(column("/x")), y_(column("/y")), p_(column("/p")),
          seconds_(t_.floating() && group_ == "/raw_events"), offset_(read_offset(path, file_)),
          block_(std::max({t_.block(), x_.block(), y_.block(), p_.block()})) {
        if (!seconds_ && !t_.integral()) {
            t_.fail("is not of an integer type, so its unit is unclear", layout_remedy);
        }
        for (const Column* other : {&x_, &y_, &p_}) {
            if (!other->integral()) {
                other->fail("is not of an integer type", layout_remedy);
            }
            if (other->size() != t_.size()) {
                fail(path_,
                     group_ + " has " + std::to_string(t_.size()) + " t, " +
                         std::to_string(x_.size()) + " x, " + std::to_string(y_.size()) +
                         " y and " + std::to_string(p_.size()) + " p",
                     "the arrays must have one length: write the file again");
            }
        }
    }

    bool read(Events& out) override {
        const QuietErrors quiet;
        if (next_ == blocks()) {
            return false;
        }
        load(next_);
        constexpr int64_t most = std::numeric_limits<uint16_t>::max();
        append(x_, out.x, most, "not from 0 to 65535");
        append(y_, out.y, most, "not from 0 to 65535");
        append(p_, out.p, 1, "neither 0 nor 1");
        out.t.insert(out.t.end(), times_.begin(), times_.end());
        ++next_;
        return true;
    }

    [[nodiscard]] size_t position() const override { return std::min(next_ * block_, t_.size()); }

    void seek(int64_t time) override {
        const QuietErrors quiet;
        if (!starts_.empty() && base_ > 0 && time <= starts_.front()) { // before what jump() found
            starts_.clear();
            base_ = 0;
            held_ = SIZE_MAX;
        }
        if (!starts_.empty() && time <= last_) {
            const auto later = std::ranges::lower_bound(starts_, time) - starts_.begin();
            next_ = base_ + static_cast<size_t>(std::max(later - 1, std::ptrdiff_t{0}));
            return;
        }
        for (next_ = passed(); next_ < blocks(); ++next_) {
            load(next_);
            if (last_ >= time) {
                break;
            }
        }
    }

    void jump(int64_t time) override {
        const QuietErrors quiet;
        if (t_.size() == 0) {
            return;
        }
        // The last block that starts before `time`, or the first one; what lies around every probe
        // bounds it.
        struct Probe {
            size_t block;
            size_t event;
            int64_t time;
        };
        Probe low{0, 0, time_at(0)};
        Probe high{blocks(), t_.size() - 1, time_at(t_.size() - 1)};
        while (low.time < time && high.block - low.block > 1) {
            const size_t block = low.block + (high.block - low.block) / 2;
            const Probe middle{block, block * block_, time_at(block * block_)};
            check_order(low.time, middle.event, middle.time);
            check_order(middle.time, high.event, high.time);
            (middle.time < time ? low : high) = middle;
        }
        starts_.clear();
        held_ = SIZE_MAX;
        base_ = next_ = low.block;
    }

    void finish() override {
        const QuietErrors quiet;
        while (passed() < blocks()) {
            load(passed());
        }
    }

    std::optional<TimeSpan> span() override {
        const QuietErrors quiet;
        if (t_.size() == 0) {
            return std::nullopt;
        }
        const TimeSpan span{time_at(0), time_at(t_.size() - 1)};
        if (span.last < span.first) {
            finish(); // finds the first place where times go back
        }
        return span;
    }

private:
    [[nodiscard]] Column column(const char* name) const {
        return {path_, file_, group_ + name, layout_remedy};
    }
    [[nodiscard]] size_t blocks() const { return (t_.size() + block_ - 1) / block_; }
    /// The first block of those behind what was passed.
    [[nodiscard]] size_t passed() const { return base_ + starts_.size(); }

    void check_order(int64_t before, size_t event, int64_t time) const {
        if (time < before) {
            fail_unsorted(path_, "event " + std::to_string(event), before, time);
        }
    }

    [[nodiscard]] int64_t time_at(size_t event) const {
        std::vector<int64_t> time(1);
        read_times(event, time);
        return time.front();
    }

    /// Microseconds of the events from `first` on.
    void read_times(size_t first, std::vector<int64_t>& times) const {
        if (seconds_) {
            std::vector<double> values(times.size());
            t_.read(first, std::span(values));
            for (size_t i = 0; i < values.size(); ++i) {
                const double microseconds = values[i] * 1e6;
                // Written so that NaN fails.
                if (!(std::abs(microseconds) <= static_cast<double>(max_event_time))) {
                    t_.fail_at(first + i, std::to_string(values[i]),
                               "which is not a time in seconds");
                }
                times[i] = std::llround(microseconds);
            }
        } else {
            t_.read(first, std::span(times));
        }
        for (size_t i = 0; i < times.size(); ++i) {
            if (times[i] > max_event_time || times[i] < -max_event_time) {
                t_.fail_at(first + i, std::to_string(times[i]),
                           "which is too large for microseconds");
            }
            times[i] += offset_;
        }
    }

    /// Brings a block's times into times_: one that was passed, or the next one.
    void load(size_t block) {
        if (held_ == block) {
            return;
        }
        held_ = SIZE_MAX;
        const size_t first = block * block_;
        times_.resize(std::min(block_, t_.size() - first));
        read_times(first, times_);
        const bool fresh = block == passed();
        int64_t before = fresh && !starts_.empty() ? last_ : times_.front();
        for (size_t i = 0; i < times_.size(); ++i) {
            check_order(before, first + i, times_[i]);
            before = times_[i];
        }
        if (fresh) {
            starts_.push_back(times_.front());
            last_ = times_.back();
        }
        held_ = block;
    }

    /// The block's values of a column, behind what `out` has.
    template <class Stored>
    void append(const Column& column, std::vector<Stored>& out, int64_t most, const char* range) {
        const size_t first = next_ * block_;
        values_.resize(times_.size());
        column.read(first, std::span(values_));
        for (size_t i = 0; i < values_.size(); ++i) {
            if (values_[i] < 0 || values_[i] > most) {
                column.fail_at(first + i, std::to_string(values_[i]), range);
            }
            out.push_back(static_cast<Stored>(values_[i]));
        }
    }

    fs::path path_;
    Id file_;
    std::string group_;
    Column t_;
    Column x_;
    Column y_;
    Column p_;
    bool seconds_;
    int64_t offset_;
    size_t block_;                ///< events
    size_t next_ = 0;             ///< the block that read() gives
    size_t base_ = 0;             ///< where passing began
    std::vector<int64_t> starts_; ///< first times of the blocks passed, base_, base_ + 1, ...
    int64_t last_ = 0;            ///< time of the last event passed
    size_t held_ = SIZE_MAX;      ///< the block whose times are in times_
    std::vector<int64_t> times_;
    std::vector<int64_t> values_;
};

} // namespace

bool hdf5_holds_events(const fs::path& path) {
    const QuietErrors quiet;
    const Id file = open_hdf5(path);
    return !file.valid() || find_group(file).has_value();
}

std::unique_ptr<EventStream> open_hdf5_events(const fs::path& path) {
    const QuietErrors quiet;
    return std::make_unique<Hdf5Events>(path);
}

} // namespace ecir::io
