#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <hdf5.h>
#include <span>
#include <string>
#include <utility>

namespace ecir::io {

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

/// Keeps HDF5's error stack, which each thread has its own of, off stderr for the scope.
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

/// Opens for reading; not valid() where HDF5 cannot.
Id open_hdf5(const std::filesystem::path& path);

/// A one-dimensional dataset (or a scalar, of one element) of numbers, read part by part.
/// Every failure is an Error(bad_input) with the file's and the dataset's name.
class Column {
public:
    /// `layout`: the remedy where the dataset is not there or not of that form.
    Column(std::filesystem::path path, const Id& file, std::string name, std::string layout);

    [[nodiscard]] size_t size() const { return size_; }
    [[nodiscard]] bool floating() const { return class_ == H5T_FLOAT; }
    /// h5py stores booleans as an enumeration.
    [[nodiscard]] bool integral() const { return class_ == H5T_INTEGER || class_ == H5T_ENUM; }
    /// How many elements are best read at a time: whole chunks, since a chunk beyond HDF5's cache
    /// is unpacked for each read that it is part of.
    [[nodiscard]] size_t block() const { return block_; }

    /// The elements from `first` on.
    void read(size_t first, std::span<int64_t> values) const;
    void read(size_t first, std::span<double> values) const;

    [[noreturn]] void fail(const std::string& what, const std::string& remedy) const;
    [[noreturn]] void fail_at(size_t index, const std::string& value,
                              const std::string& what) const;

private:
    void read(size_t first, size_t count, hid_t type, void* values) const;
    void set_block();

    std::filesystem::path path_;
    std::string name_;
    std::string layout_;
    Id dataset_;
    size_t size_ = 0;
    size_t block_ = 0;
    bool scalar_ = false;
    H5T_class_t class_ = H5T_NO_CLASS;
};

} // namespace ecir::io
