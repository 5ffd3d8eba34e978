#include <cstdint>
#include <doctest/doctest.h>
#include <filesystem>
#include <hdf5.h>
#include <string>
#include <vector>

#include "tests/test_io_support.hpp"
#include "tools/io/event_file.hpp"

using namespace ecir;
using namespace ecir::test;

namespace {

template <class T> hid_t type_of();
template <> hid_t type_of<int8_t>() {
    return H5T_NATIVE_INT8;
}
template <> hid_t type_of<uint8_t>() {
    return H5T_NATIVE_UINT8;
}
template <> hid_t type_of<int16_t>() {
    return H5T_NATIVE_INT16;
}
template <> hid_t type_of<uint16_t>() {
    return H5T_NATIVE_UINT16;
}
template <> hid_t type_of<int32_t>() {
    return H5T_NATIVE_INT32;
}
template <> hid_t type_of<uint32_t>() {
    return H5T_NATIVE_UINT32;
}
template <> hid_t type_of<int64_t>() {
    return H5T_NATIVE_INT64;
}
template <> hid_t type_of<uint64_t>() {
    return H5T_NATIVE_UINT64;
}
template <> hid_t type_of<double>() {
    return H5T_NATIVE_DOUBLE;
}

/// Writes HDF5 of any types, to be read by the code under test.
class Hdf5 {
public:
    explicit Hdf5(const std::filesystem::path& path, const char* group = "/events")
        : file_(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT)) {
        H5Gclose(H5Gcreate2(file_, group, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    }
    ~Hdf5() { H5Fclose(file_); }
    Hdf5(const Hdf5&) = delete;
    Hdf5& operator=(const Hdf5&) = delete;

    template <class T> Hdf5& add(const char* name, const std::vector<T>& values) {
        const hsize_t count = values.size();
        return add(name, values, H5Screate_simple(1, &count, nullptr), type_of<T>());
    }
    template <class T> Hdf5& scalar(const char* name, T value) {
        return add(name, std::vector<T>{value}, H5Screate(H5S_SCALAR), type_of<T>());
    }
    /// As h5py stores booleans.
    Hdf5& booleans(const char* name, const std::vector<int8_t>& values) {
        const hid_t type = H5Tenum_create(H5T_NATIVE_INT8);
        for (int8_t value = 0; value < 2; ++value) {
            H5Tenum_insert(type, value == 0 ? "FALSE" : "TRUE", &value);
        }
        const hsize_t count = values.size();
        add(name, values, H5Screate_simple(1, &count, nullptr), type);
        H5Tclose(type);
        return *this;
    }
    /// A dataset whose only chunk claims to be packed by `filter`.
    Hdf5& packed(const char* name, H5Z_filter_t filter) {
        const hsize_t count = 4;
        const hid_t space = H5Screate_simple(1, &count, nullptr);
        const hid_t list = H5Pcreate(H5P_DATASET_CREATE);
        H5Pset_chunk(list, 1, &count);
        H5Pset_filter(list, filter, H5Z_FLAG_OPTIONAL, 0, nullptr);
        const hid_t set =
            H5Dcreate2(file_, name, H5T_NATIVE_INT64, space, H5P_DEFAULT, list, H5P_DEFAULT);
        const hsize_t start = 0;
        H5Dwrite_chunk(set, H5P_DEFAULT, 0, &start, 7, "garbage");
        H5Dclose(set);
        H5Pclose(list);
        H5Sclose(space);
        return *this;
    }

private:
    template <class T>
    Hdf5& add(const char* name, const std::vector<T>& values, hid_t space, hid_t type) {
        const hid_t set =
            H5Dcreate2(file_, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
        H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
        H5Dclose(set);
        H5Sclose(space);
        return *this;
    }
    hid_t file_;
};

template <class T, class X, class P>
std::filesystem::path write_hdf5(const TemporaryFolder& folder, const std::vector<T>& t,
                                 const std::vector<X>& x, const std::vector<P>& p) {
    auto path = folder / "events.h5";
    Hdf5(path).add("/events/t", t).add("/events/x", x).add("/events/y", x).add("/events/p", p);
    return path;
}

const std::vector<int64_t> times = {10, 20, 20, 30};
const std::vector<uint16_t> places = {0, 5, 65535, 7};
const std::vector<uint8_t> signs = {0, 1, 1, 0};

} // namespace

TEST_SUITE("io") {

    TEST_CASE("event HDF5: what is written comes back") {
        const TemporaryFolder folder;
        const Events events = many_events(300001);
        io::write_events(folder / "e.h5", events.view());
        const auto file = io::read_events(folder / "e.h5");
        CHECK(file.events.t == events.t);
        CHECK(file.events.x == events.x);
        CHECK(file.events.y == events.y);
        CHECK(file.events.p == events.p);
        CHECK(std::filesystem::file_size(folder / "e.h5") < 13 * events.size() / 2);
    }

    TEST_CASE("event HDF5: no events") {
        const TemporaryFolder folder;
        io::write_events(folder / "e.h5", {});
        CHECK(io::read_events(folder / "e.h5").events.size() == 0);
    }

    TEST_CASE("event HDF5: any integer type, and booleans") {
        const TemporaryFolder folder;
        const auto check = [](const std::filesystem::path& path) {
            const auto file = io::read_events(path);
            CHECK(file.events.t == std::vector<int64_t>{1, 2, 3});
            CHECK(file.events.x == std::vector<uint16_t>{4, 5, 6});
            CHECK(file.events.p == std::vector<uint8_t>{0, 1, 0});
        };
        using std::vector;
        check(write_hdf5(folder, vector<uint32_t>{1, 2, 3}, vector<int16_t>{4, 5, 6},
                         vector<int8_t>{0, 1, 0}));
        check(write_hdf5(folder, vector<uint64_t>{1, 2, 3}, vector<int64_t>{4, 5, 6},
                         vector<uint16_t>{0, 1, 0}));
        check(write_hdf5(folder, vector<int32_t>{1, 2, 3}, vector<uint8_t>{4, 5, 6},
                         vector<int64_t>{0, 1, 0}));
        Hdf5(folder / "b.h5")
            .add("/events/t", vector<int64_t>{1, 2, 3})
            .add("/events/x", vector<int32_t>{4, 5, 6})
            .add("/events/y", vector<int32_t>{4, 5, 6})
            .booleans("/events/p", {0, 1, 0});
        check(folder / "b.h5");
    }

    TEST_CASE("event HDF5: t_offset is added, as a scalar or an array of one") {
        const TemporaryFolder folder;
        for (const bool scalar : {true, false}) {
            const auto path = folder / "o.h5";
            {
                Hdf5 file(path);
                file.add("/events/t", std::vector<uint32_t>{1, 4000000000})
                    .add("/events/x", std::vector<uint16_t>{1, 2})
                    .add("/events/y", std::vector<uint16_t>{1, 2})
                    .add("/events/p", std::vector<uint8_t>{1, 0});
                if (scalar) {
                    file.scalar<int64_t>("/t_offset", 1615007563376030);
                } else {
                    file.add("/t_offset", std::vector<int64_t>{1615007563376030});
                }
            }
            CHECK(io::read_events(path).events.t ==
                  std::vector<int64_t>{1615007563376031, 1615011563376030});
        }
    }

    TEST_CASE("event HDF5: raw_events with seconds in floating point") {
        const TemporaryFolder folder;
        const auto path = folder / "r.h5";
        Hdf5(path, "/raw_events")
            .add("/raw_events/t", std::vector<double>{0.000779999, 1615007563.376030})
            .add("/raw_events/x", std::vector<int32_t>{1, 2})
            .add("/raw_events/y", std::vector<int32_t>{1, 2})
            .booleans("/raw_events/p", {0, 1});
        CHECK(io::read_events(path).events.t == std::vector<int64_t>{780, 1615007563376030});
    }

    TEST_CASE("event HDF5: floating-point times in DSEC's layout are refused") {
        const TemporaryFolder folder;
        const auto path = write_hdf5(folder, std::vector<double>{1, 2, 3, 4}, places, signs);
        check_error(
            ExitCode::bad_input, [&] { io::read_events(path); }, "/events/t", "integer");
    }

    TEST_CASE("event HDF5: the first time that goes back is named") {
        const TemporaryFolder folder;
        const auto path = write_hdf5(folder, std::vector<int64_t>{10, 20, 19, 5}, places, signs);
        check_error(
            ExitCode::bad_input, [&] { io::read_events(path); }, "events.h5", "event 2", "19 us",
            "20 us", "sort");
    }

    TEST_CASE("event HDF5: times out of range") {
        const TemporaryFolder folder;
        const std::vector<uint64_t> t = {10, 20, 20, 18000000000000000000U};
        const auto path = write_hdf5(folder, t, places, signs);
        check_error(
            ExitCode::bad_input, [&] { io::read_events(path); }, "/events/t", "event 3");
    }

    TEST_CASE("event HDF5: bad polarity and coordinates name the event") {
        const TemporaryFolder folder;
        const auto p = write_hdf5(folder, times, places, std::vector<int8_t>{0, 1, -1, 1});
        check_error(
            ExitCode::bad_input, [&] { io::read_events(p); }, "/events/p", "-1", "event 2");
        const auto x = write_hdf5(folder, times, std::vector<int32_t>{0, 65536, 0, 0}, signs);
        check_error(
            ExitCode::bad_input, [&] { io::read_events(x); }, "/events/x", "65536", "event 1");
        const auto y = write_hdf5(folder, times, std::vector<int16_t>{0, 1, 2, -7}, signs);
        check_error(
            ExitCode::bad_input, [&] { io::read_events(y); }, "/events/", "-7", "event 3");
    }

    TEST_CASE("event HDF5: missing and unequal columns") {
        const TemporaryFolder folder;
        const auto path = write_hdf5(folder, times, places, std::vector<uint8_t>{0, 1});
        check_error(
            ExitCode::bad_input, [&] { io::read_events(path); }, "4 t", "2 p");
        Hdf5(folder / "m.h5").add("/events/t", times).add("/events/x", places);
        check_error(
            ExitCode::bad_input, [&] { io::read_events(folder / "m.h5"); }, "/events/y");
        Hdf5(folder / "n.h5").add("/events/x", places);
        check_error(
            ExitCode::bad_input, [&] { io::read_events(folder / "n.h5"); }, "n.h5", "no /events/t");
    }

    TEST_CASE("event HDF5: truncated files are errors") {
        const TemporaryFolder folder;
        io::write_events(folder / "e.h5", many_events(50000).view());
        for (const double share : {0.999, 0.5, 0.01}) {
            CAPTURE(share);
            const auto cut = truncate(folder / "e.h5", folder / "cut.h5", share);
            check_error(
                ExitCode::bad_input, [&] { io::read_events(cut); }, "cut.h5", "truncated");
        }
    }

    TEST_CASE("event HDF5: flipped bits in the packed data are an error") {
        const TemporaryFolder folder;
        io::write_events(folder / "e.h5", many_events(50000).view());
        std::string bytes = get(folder / "e.h5");
        bytes.replace(bytes.size() / 2, 64, std::string(64, '\x55'));
        const auto path = put(folder / "b.h5", bytes);
        check_error(
            ExitCode::bad_input, [&] { io::read_events(path); }, "b.h5", "damaged");
    }

    TEST_CASE("event HDF5: a missing filter plugin is named with its package") {
        if (H5Zfilter_avail(32001) > 0) {
            return; // Blosc is installed here
        }
        const TemporaryFolder folder;
        Hdf5(folder / "blosc.h5")
            .packed("/events/t", 32001)
            .add("/events/x", places)
            .add("/events/y", places)
            .add("/events/p", signs);
        check_error(
            ExitCode::bad_input, [&] { io::read_events(folder / "blosc.h5"); }, "blosc.h5",
            "/events/t", "Blosc", "hdf5-filter-plugin-blosc-serial");
    }

    TEST_CASE("event HDF5: a full disk is exit 5, a missing folder exit 3") {
        const TemporaryFolder folder;
        std::filesystem::create_symlink("/dev/full", folder / "full.h5");
        check_error(
            ExitCode::resources,
            [&] { io::write_events(folder / "full.h5", many_events(1000).view()); }, "full.h5",
            "space");
        check_error(
            ExitCode::bad_input,
            [&] { io::write_events(folder / "none/e.h5", many_events(10).view()); }, "none");
    }

} // TEST_SUITE
