#include "tools/io/file.hpp"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

/// A file descriptor that is closed on leaving the scope.
class Descriptor {
public:
    explicit Descriptor(int number) : number_(number) {}
    ~Descriptor() {
        if (number_ >= 0) {
            ::close(number_);
        }
    }
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    [[nodiscard]] int get() const { return number_; }

private:
    int number_;
};

const char* remedy(int error_number) {
    switch (error_number) {
    case ENOENT:
        return "check the name and that its folder exists";
    case EACCES:
    case EPERM:
        return "check the permissions or choose another place";
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
        return "free some space or write to another disk";
    case ENOMEM:
        return "free some memory";
    case EROFS:
        return "choose a place that is not mounted read-only";
    case ENOTDIR:
        return "a part of the path before the last is not a folder; check the path";
    case EISDIR:
        return "this is a folder, give a file";
    case ENAMETOOLONG:
        return "choose a shorter name";
    default:
        return "check the path and the disk";
    }
}

/// Reads until `bytes` is full or the file ends; returns how many were read.
/// some(to, count, done): as read(2), of what follows the `done` bytes read so far.
template <class Some>
size_t read_into(const fs::path& path, std::span<uint8_t> bytes, const Some& some) {
    size_t done = 0;
    while (done < bytes.size()) {
        const ssize_t got = some(bytes.data() + done, bytes.size() - done, done);
        if (got < 0 && errno != EINTR) {
            throw system_error(errno, path, "cannot read");
        }
        if (got == 0) {
            break;
        }
        done += got > 0 ? static_cast<size_t>(got) : 0;
    }
    return done;
}

size_t read_on(int descriptor, const fs::path& path, std::span<uint8_t> bytes) {
    return read_into(path, bytes, [&](uint8_t* to, size_t count, size_t) {
        return ::read(descriptor, to, count);
    });
}

Descriptor open_input(const fs::path& path) {
    const int number = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (number < 0) {
        throw system_error(errno, path, "cannot open");
    }
    return Descriptor(number);
}

void write_part(int descriptor, std::span<const uint8_t> bytes, const fs::path& path) {
    while (!bytes.empty()) {
        const ssize_t put = ::write(descriptor, bytes.data(), bytes.size());
        if (put < 0 && errno != EINTR) {
            throw system_error(errno, path, "cannot write");
        }
        bytes = bytes.subspan(put > 0 ? static_cast<size_t>(put) : 0);
    }
}

} // namespace

Error system_error(int error_number, const fs::path& path, const std::string& action) {
    const bool space = error_number == ENOSPC || error_number == EDQUOT || error_number == EFBIG ||
                       error_number == ENOMEM;
    return {space ? ExitCode::resources : ExitCode::bad_input,
            path.string() + ": " + action + ": " + std::strerror(error_number) + "; " +
                remedy(error_number)};
}

std::vector<uint8_t> read_file(const fs::path& path) {
    const Descriptor file = open_input(path);
    struct stat about {};
    if (::fstat(file.get(), &about) != 0) {
        throw system_error(errno, path, "cannot read");
    }
    if (S_ISDIR(about.st_mode)) {
        throw system_error(EISDIR, path, "cannot read");
    }
    // A size of 0 also stands for pipes and the like: those are read in growing steps.
    std::vector<uint8_t> bytes(static_cast<size_t>(about.st_size) + 1);
    size_t done = 0;
    while ((done += read_on(file.get(), path, std::span(bytes).subspan(done))) == bytes.size()) {
        bytes.resize(2 * bytes.size() + 4096);
    }
    bytes.resize(done);
    return bytes;
}

std::vector<uint8_t> read_start(const fs::path& path, size_t count) {
    const Descriptor file = open_input(path);
    std::vector<uint8_t> bytes(count);
    bytes.resize(read_on(file.get(), path, bytes));
    return bytes;
}

FileReader::FileReader(fs::path path)
    : path_(std::move(path)), descriptor_(::open(path_.c_str(), O_RDONLY | O_CLOEXEC)) {
    struct stat about {};
    if (descriptor_ < 0 || ::fstat(descriptor_, &about) != 0) {
        throw system_error(errno, path_, "cannot open");
    }
    size_ = about.st_size;
}

FileReader::~FileReader() {
    ::close(descriptor_);
}

size_t FileReader::read(int64_t offset, std::span<uint8_t> bytes) const {
    return read_into(path_, bytes, [&](uint8_t* to, size_t count, size_t done) {
        return ::pread(descriptor_, to, count, offset + static_cast<int64_t>(done));
    });
}

FileWriter::FileWriter(fs::path path)
    : path_(std::move(path)),
      descriptor_(::open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666)) {
    if (descriptor_ < 0) {
        throw system_error(errno, path_, "cannot create");
    }
    struct stat about {};
    regular_ = ::fstat(descriptor_, &about) == 0 && S_ISREG(about.st_mode);
}

FileWriter::~FileWriter() {
    if (descriptor_ >= 0) {
        ::close(descriptor_);
        if (regular_) {
            ::unlink(path_.c_str());
        }
    }
}

void FileWriter::write(std::span<const uint8_t> bytes) {
    write_part(descriptor_, bytes, path_);
}

void FileWriter::close() {
    // Some file systems report a lack of space only here.
    if (::close(std::exchange(descriptor_, -1)) != 0) {
        const int error_number = errno;
        if (regular_) {
            ::unlink(path_.c_str());
        }
        throw system_error(error_number, path_, "cannot write");
    }
}

void write_file(const fs::path& path, std::initializer_list<std::span<const uint8_t>> parts) {
    FileWriter file(path);
    for (const auto& part : parts) {
        file.write(part);
    }
    file.close();
}

void check_can_grow(const fs::path& path) {
    const Descriptor file(::open(path.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC));
    struct stat about {};
    if (file.get() < 0 || ::fstat(file.get(), &about) != 0) {
        throw system_error(errno, path, "cannot write");
    }
    // More than what a library tends to write at a time, so that its last write would have fitted.
    const std::vector<uint8_t> block(size_t{1} << 16U);
    const auto restore = [&] {
        return !S_ISREG(about.st_mode) || ::ftruncate(file.get(), about.st_size) == 0;
    };
    try {
        write_part(file.get(), block, path);
    } catch (const Error&) {
        (void)restore();
        throw;
    }
    if (!restore()) {
        throw system_error(errno, path, "cannot write");
    }
}

std::string lower_extension(const fs::path& path) {
    std::string extension = path.extension().string();
    std::ranges::transform(extension, extension.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return extension;
}

bool lies_within(const fs::path& inner, const fs::path& outer) {
    std::error_code ignored;
    const fs::path in = fs::weakly_canonical(inner, ignored);
    const fs::path out = fs::weakly_canonical(outer, ignored);
    return !out.empty() &&
           std::mismatch(out.begin(), out.end(), in.begin(), in.end()).first == out.end();
}

} // namespace ecir::io
