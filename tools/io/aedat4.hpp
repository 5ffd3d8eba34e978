#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "tools/io/file.hpp"

namespace ecir::io {

/// Whether a file that starts with `start` is of iniVation's AEDAT 4.
bool is_aedat4(std::span<const uint8_t> start);

/// The packets of one stream of an AEDAT 4 file, found by the file's own table or, where that is
/// not there (the recording was not ended) or says too little (older versions), by one pass over
/// it. Packets are compressed one by one and hold a FlatBuffer each (tools/io/aedat4.fbs).
class Aedat4Stream {
public:
    enum class Kind { events, frames };

    struct Packet {
        int64_t position = 0;   ///< in the file, of its first byte
        int32_t size = 0;       ///< bytes, as stored
        int64_t elements = 0;   ///< events
        int64_t first_time = 0; ///< microseconds, of the first element
        int64_t last_time = 0;
    };

    /// Finds the packets of the only stream of a kind. Throws Error(bad_input) naming the file and
    /// the place: not of this format, damaged, several such streams.
    Aedat4Stream(const std::filesystem::path& path, Kind kind);
    ~Aedat4Stream();
    Aedat4Stream(const Aedat4Stream&) = delete;
    Aedat4Stream& operator=(const Aedat4Stream&) = delete;

    [[nodiscard]] const std::filesystem::path& path() const { return file_.path(); }
    /// Whether there is such a stream; otherwise there are no packets.
    [[nodiscard]] bool found() const { return found_; }
    /// In the order of the file, those without events left out.
    [[nodiscard]] const std::vector<Packet>& packets() const { return packets_; }

    /// A packet's FlatBuffer with its size before it, checked as far as FlatBuffers does; valid
    /// until the next call. Throws Error(bad_input) where it is damaged.
    std::span<const uint8_t> unpack(const Packet& packet);

    /// Of a damaged packet.
    [[noreturn]] void fail(const Packet& packet, const std::string& what) const;

private:
    class Unpacker;
    class Finder;

    std::span<const uint8_t> decompress(const Packet& packet);

    FileReader file_;
    Kind kind_;
    bool found_ = false;
    std::unique_ptr<Unpacker> unpacker_;
    std::vector<Packet> packets_;
    std::vector<uint8_t> packed_;
};

} // namespace ecir::io
