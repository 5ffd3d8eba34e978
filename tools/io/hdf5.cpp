#include "tools/io/hdf5.hpp"

#include <algorithm>
#include <array>

#include "runtime/error.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

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

} // namespace

Id open_hdf5(const fs::path& path) {
    const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    // Without locks, which read-only and network file systems refuse.
    H5Pset_file_locking(access.get(), false, true);
    return {H5Fopen(path.c_str(), H5F_ACC_RDONLY, access.get()), H5Fclose};
}

Column::Column(fs::path path, const Id& file, std::string name, std::string layout)
    : path_(std::move(path)), name_(std::move(name)), layout_(std::move(layout)),
      dataset_(H5Dopen2(file.get(), name_.c_str(), H5P_DEFAULT), H5Dclose) {
    if (!dataset_.valid()) {
        fail("is not there or not a dataset", layout_);
    }
    const Id space(H5Dget_space(dataset_.get()), H5Sclose);
    const int rank = H5Sget_simple_extent_ndims(space.get());
    const hssize_t count = H5Sget_simple_extent_npoints(space.get());
    if (rank < 0 || rank > 1 || count < 0) {
        fail("is not one-dimensional", layout_);
    }
    size_ = static_cast<size_t>(count);
    scalar_ = rank == 0;
    const Id type(H5Dget_type(dataset_.get()), H5Tclose);
    class_ = H5Tget_class(type.get());
    set_block();
}

void Column::set_block() {
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

void Column::read(size_t first, std::span<int64_t> values) const {
    read(first, values.size(), H5T_NATIVE_INT64, values.data());
}

void Column::read(size_t first, std::span<double> values) const {
    read(first, values.size(), H5T_NATIVE_DOUBLE, values.data());
}

void Column::read(size_t first, size_t count, hid_t type, void* values) const {
    if (count == 0) {
        return;
    }
    const hsize_t start = first;
    const hsize_t length = count;
    const Id space(H5Dget_space(dataset_.get()), H5Sclose);
    const Id memory(H5Screate_simple(1, &length, nullptr), H5Sclose);
    const bool chosen = scalar_ || H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, &start, nullptr,
                                                       &length, nullptr) >= 0;
    if (chosen &&
        H5Dread(dataset_.get(), type, memory.get(), space.get(), H5P_DEFAULT, values) >= 0) {
        return;
    }
    const std::string missing = missing_filter(dataset_.get());
    if (!missing.empty()) {
        throw Error(ExitCode::bad_input, path_.string() + ": " + name_ + " " + missing);
    }
    fail("cannot be read from element " + std::to_string(first) + " on",
         "the file is damaged or truncated: copy it again");
}

void Column::fail(const std::string& what, const std::string& remedy) const {
    throw Error(ExitCode::bad_input, path_.string() + ": " + name_ + " " + what + "; " + remedy);
}

void Column::fail_at(size_t index, const std::string& value, const std::string& what) const {
    fail("is " + value + " at event " + std::to_string(index) + ", " + what, layout_);
}

} // namespace ecir::io
