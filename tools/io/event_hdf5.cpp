#include <algorithm>
#include <array>
#include <cmath>
#include <hdf5.h>
#include <limits>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "runtime/error.hpp"
#include "tools/io/event_formats.hpp"
#include "tools/io/file.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

/// An HDF5 identifier, closed on leaving the scope by the function for its kind.
class Id {
public:
    using Closer = herr_t (*)(hid_t);
    Id(hid_t id, Closer closer) : id_(id), closer_(closer) {}
    ~Id() { close(); }
    Id(Id&& other) noexcept : id_(std::exchange(other.id_, -1)), closer_(other.closer_) {}
    Id& operator=(Id&&) = delete;
    [[nodiscard]] hid_t get() const { return id_; }
    [[nodiscard]] bool valid() const { return id_ >= 0; }
    bool close() {
        const hid_t id = std::exchange(id_, -1);
        return id < 0 || closer_(id) >= 0;
    }

private:
    hid_t id_;
    Closer closer_;
};

/// Keeps HDF5's error stack off stderr for the scope.
class QuietErrors {
public:
    QuietErrors() {
        H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
        H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    }
    ~QuietErrors() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }
    QuietErrors(const QuietErrors&) = delete;
    QuietErrors& operator=(const QuietErrors&) = delete;

private:
    H5E_auto2_t function_ = nullptr;
    void* data_ = nullptr;
};

[[noreturn]] void fail(const fs::path& path, const std::string& what, const std::string& remedy) {
    throw Error(ExitCode::bad_input, path.string() + ": " + what + "; " + remedy);
}

constexpr const char* layout_remedy =
    "store /events/t (integer microseconds), x, y and p (0 or 1), as DSEC does";

Id open_file(const fs::path& path) {
    const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    // Without locks, which read-only and network file systems refuse.
    H5Pset_file_locking(access.get(), false, true);
    return {H5Fopen(path.c_str(), H5F_ACC_RDONLY, access.get()), H5Fclose};
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

/// What is missing when a dataset's filters are not all here, or "".
std::string missing_filter(hid_t dataset) {
    const Id list(H5Dget_create_plist(dataset), H5Pclose);
    const int count = list.valid() ? H5Pget_nfilters(list.get()) : 0;
    for (int i = 0; i < count; ++i) {
        unsigned flags = 0;
        unsigned config = 0;
        size_t parameters = 0;
        std::array<char, 80> name{};
        const H5Z_filter_t id =
            H5Pget_filter2(list.get(), static_cast<unsigned>(i), &flags, &parameters, nullptr,
                           name.size() - 1, name.data(), &config);
        if (id < 0 || H5Zfilter_avail(id) > 0) {
            continue;
        }
        const bool blosc = id == 32001;
        return std::string("is compressed with ") + (blosc ? "Blosc" : name.data()) +
               " (HDF5 filter " + std::to_string(id) + "), whose plugin is not installed; " +
               (blosc ? "install it (Debian: hdf5-filter-plugin-blosc-serial)" : "install it") +
               " or set HDF5_PLUGIN_PATH to its folder, or repack the file with gzip (h5repack)";
    }
    return "";
}

/// A one-dimensional dataset (or a scalar, of one element) read block by block.
class Column {
public:
    Column(const fs::path& path, const Id& file, std::string name)
        : path_(path), name_(std::move(name)),
          dataset_(H5Dopen2(file.get(), name_.c_str(), H5P_DEFAULT), H5Dclose) {
        if (!dataset_.valid()) {
            fail("is not there or not a dataset", layout_remedy);
        }
        const Id space(H5Dget_space(dataset_.get()), H5Sclose);
        const int rank = H5Sget_simple_extent_ndims(space.get());
        const hssize_t count = H5Sget_simple_extent_npoints(space.get());
        if (rank < 0 || rank > 1 || count < 0) {
            fail("is not one-dimensional", layout_remedy);
        }
        size_ = static_cast<size_t>(count);
        scalar_ = rank == 0;
        const Id type(H5Dget_type(dataset_.get()), H5Tclose);
        class_ = H5Tget_class(type.get());
        set_block();
    }

    [[nodiscard]] size_t size() const { return size_; }
    [[nodiscard]] bool floating() const { return class_ == H5T_FLOAT; }
    /// h5py stores booleans as an enumeration.
    [[nodiscard]] bool integral() const { return class_ == H5T_INTEGER || class_ == H5T_ENUM; }

    /// Calls take(index, value) for every element, in order.
    template <class Value, class Take> void each(Take take) const {
        const hid_t memory_type =
            std::is_same_v<Value, double> ? H5T_NATIVE_DOUBLE : H5T_NATIVE_INT64;
        std::vector<Value> buffer(std::min(block_, size_));
        for (size_t first = 0; first < size_; first += buffer.size()) {
            const hsize_t start = first;
            const hsize_t count = std::min(buffer.size(), size_ - first);
            const Id space(H5Dget_space(dataset_.get()), H5Sclose);
            const Id memory(H5Screate_simple(1, &count, nullptr), H5Sclose);
            const bool chosen = scalar_ || H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, &start,
                                                               nullptr, &count, nullptr) >= 0;
            if (!chosen || H5Dread(dataset_.get(), memory_type, memory.get(), space.get(),
                                   H5P_DEFAULT, buffer.data()) < 0) {
                fail_read(first);
            }
            for (size_t i = 0; i < count; ++i) {
                take(first + i, buffer[i]);
            }
        }
    }

    [[noreturn]] void fail(const std::string& what, const std::string& remedy) const {
        io::fail(path_, name_ + " " + what, remedy);
    }
    [[noreturn]] void fail_at(size_t index, const std::string& value,
                              const std::string& what) const {
        fail("is " + value + " at event " + std::to_string(index) + ", " + what, layout_remedy);
    }

private:
    /// Whole chunks at a time: a chunk beyond HDF5's cache is unpacked for each read it is part of.
    void set_block() {
        constexpr hsize_t usual = hsize_t{1} << 18U;
        const Id list(H5Dget_create_plist(dataset_.get()), H5Pclose);
        hsize_t chunk = 1;
        if (H5Pget_layout(list.get()) == H5D_CHUNKED && H5Pget_chunk(list.get(), 1, &chunk) == 1 &&
            chunk > 0) {
            block_ = chunk * std::max(usual / chunk, hsize_t{1});
        } else {
            block_ = usual;
        }
    }

    [[noreturn]] void fail_read(size_t first) const {
        const std::string missing = missing_filter(dataset_.get());
        if (!missing.empty()) {
            throw Error(ExitCode::bad_input, path_.string() + ": " + name_ + " " + missing);
        }
        fail("cannot be read from element " + std::to_string(first) + " on",
             "the file is damaged or truncated: copy it again");
    }

    const fs::path& path_;
    std::string name_;
    Id dataset_;
    size_t size_ = 0;
    size_t block_ = 0;
    bool scalar_ = false;
    H5T_class_t class_ = H5T_NO_CLASS;
};

template <class Stored>
std::vector<Stored> read_small(const Column& column, int64_t most, const char* range) {
    if (!column.integral()) {
        column.fail("is not of an integer type", layout_remedy);
    }
    std::vector<Stored> values(column.size());
    column.each<int64_t>([&](size_t i, int64_t value) {
        if (value < 0 || value > most) {
            column.fail_at(i, std::to_string(value), range);
        }
        values[i] = static_cast<Stored>(value);
    });
    return values;
}

int64_t read_offset(const fs::path& path, const Id& file) {
    if (H5Lexists(file.get(), "/t_offset", H5P_DEFAULT) <= 0) {
        return 0;
    }
    const Column column(path, file, "/t_offset");
    if (column.size() != 1 || !column.integral()) {
        column.fail("is not a single integer", "store it as one integer of microseconds");
    }
    int64_t offset = 0;
    column.each<int64_t>([&](size_t, int64_t value) { offset = value; });
    if (offset > max_event_time || offset < -max_event_time) {
        column.fail("is too large", "store it as one integer of microseconds");
    }
    return offset;
}

std::vector<int64_t> read_times(const fs::path& path, const Column& column, int64_t offset,
                                bool seconds) {
    std::vector<int64_t> times(column.size());
    const auto take = [&](size_t i, int64_t time) {
        if (time > max_event_time || time < -max_event_time) {
            column.fail_at(i, std::to_string(time), "which is too large for microseconds");
        }
        times[i] = time + offset;
        if (i > 0 && times[i] < times[i - 1]) {
            fail_unsorted(path, "event " + std::to_string(i), times[i - 1], times[i]);
        }
    };
    if (seconds) {
        column.each<double>([&](size_t i, double value) {
            const double microseconds = value * 1e6;
            // Written so that NaN fails.
            if (!(std::abs(microseconds) <= static_cast<double>(max_event_time))) {
                column.fail_at(i, std::to_string(value), "which is not a time in seconds");
            }
            take(i, std::llround(microseconds));
        });
    } else {
        column.each<int64_t>(take);
    }
    return times;
}

EventFile read_group(const fs::path& path, const Id& file, const std::string& group) {
    const Column t(path, file, group + "/t");
    const Column x(path, file, group + "/x");
    const Column y(path, file, group + "/y");
    const Column p(path, file, group + "/p");
    const bool seconds = t.floating() && group == "/raw_events";
    if (!seconds && !t.integral()) {
        t.fail("is not of an integer type, so its unit is unclear", layout_remedy);
    }
    if (x.size() != t.size() || y.size() != t.size() || p.size() != t.size()) {
        fail(path,
             group + " has " + std::to_string(t.size()) + " t, " + std::to_string(x.size()) +
                 " x, " + std::to_string(y.size()) + " y and " + std::to_string(p.size()) + " p",
             "the arrays must have one length: write the file again");
    }
    EventFile result;
    try {
        constexpr int64_t most = std::numeric_limits<uint16_t>::max();
        result.events.t = read_times(path, t, read_offset(path, file), seconds);
        result.events.x = read_small<uint16_t>(x, most, "not from 0 to 65535");
        result.events.y = read_small<uint16_t>(y, most, "not from 0 to 65535");
        result.events.p = read_small<uint8_t>(p, 1, "neither 0 nor 1");
    } catch (const std::bad_alloc&) {
        throw Error(ExitCode::resources, path.string() + ": not enough memory for " +
                                             std::to_string(t.size()) +
                                             " events; cut the recording into parts");
    } catch (const std::length_error&) {
        t.fail("has an impossible length of " + std::to_string(t.size()),
               "the file is damaged: copy it again");
    }
    return result;
}

void write_column(const Id& file, const char* name, hid_t file_type, hid_t memory_type,
                  const void* data, hsize_t count) {
    constexpr hsize_t chunk = 65536;
    constexpr unsigned gzip_level = 4;
    const hsize_t unlimited = H5S_UNLIMITED; // a fixed size must not be below a chunk
    const Id space(H5Screate_simple(1, &count, &unlimited), H5Sclose);
    const Id list(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_chunk(list.get(), 1, &chunk);
    H5Pset_shuffle(list.get());
    H5Pset_deflate(list.get(), gzip_level);
    const Id dataset(
        H5Dcreate2(file.get(), name, file_type, space.get(), H5P_DEFAULT, list.get(), H5P_DEFAULT),
        H5Dclose);
    if (!dataset.valid() || (count > 0 && H5Dwrite(dataset.get(), memory_type, H5S_ALL, H5S_ALL,
                                                   H5P_DEFAULT, data) < 0)) {
        throw std::bad_alloc();
    }
}

/// The file as bytes. HDF5 gets to write to memory only: its own answer to a full disk is an
/// identifier that can neither be used nor closed.
std::vector<uint8_t> make_file(const EventView& events) {
    const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    H5Pset_fapl_core(access.get(), size_t{1} << 24U, false);
    const Id file(H5Fcreate("events.h5", H5F_ACC_TRUNC, H5P_DEFAULT, access.get()), H5Fclose);
    const Id group(H5Gcreate2(file.get(), "/events", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                   H5Gclose);
    if (!group.valid()) {
        throw std::bad_alloc();
    }
    const hsize_t count = events.size();
    write_column(file, "/events/t", H5T_STD_I64LE, H5T_NATIVE_INT64, events.t.data(), count);
    write_column(file, "/events/x", H5T_STD_U16LE, H5T_NATIVE_UINT16, events.x.data(), count);
    write_column(file, "/events/y", H5T_STD_U16LE, H5T_NATIVE_UINT16, events.y.data(), count);
    write_column(file, "/events/p", H5T_STD_U8LE, H5T_NATIVE_UINT8, events.p.data(), count);
    H5Fflush(file.get(), H5F_SCOPE_LOCAL);
    const ssize_t size = H5Fget_file_image(file.get(), nullptr, 0);
    std::vector<uint8_t> bytes(size > 0 ? static_cast<size_t>(size) : 0);
    if (size <= 0 || H5Fget_file_image(file.get(), bytes.data(), bytes.size()) != size) {
        throw std::bad_alloc();
    }
    return bytes;
}

} // namespace

bool hdf5_holds_events(const fs::path& path) {
    const QuietErrors quiet;
    const Id file = open_file(path);
    return !file.valid() || find_group(file).has_value();
}

EventFile read_hdf5_events(const fs::path& path) {
    const QuietErrors quiet;
    const Id file = open_file(path);
    if (!file.valid()) {
        fail(path, "HDF5 cannot open it: truncated or damaged", "copy the file again");
    }
    const auto group = find_group(file);
    if (!group) {
        fail(path, "has no /events/t", layout_remedy);
    }
    return read_group(path, file, *group);
}

void write_events(const fs::path& path, const EventView& events) {
    const QuietErrors quiet;
    std::vector<uint8_t> bytes;
    try {
        bytes = make_file(events);
    } catch (const std::bad_alloc&) {
        throw Error(ExitCode::resources, path.string() + ": not enough memory to pack " +
                                             std::to_string(events.size()) +
                                             " events; write fewer at a time");
    }
    write_file(path, {bytes});
}

} // namespace ecir::io
