#include <new>
#include <string>
#include <vector>

#include "runtime/error.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/file.hpp"
#include "tools/io/hdf5.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

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
