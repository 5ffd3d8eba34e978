#include "tools/io/aedat4.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <lz4frame.h>
#include <map>
#include <optional>
#include <string_view>
#include <zstd.h>

#include "aedat4_generated.h"
#include "runtime/error.hpp"

namespace ecir::io {

namespace fs = std::filesystem;
namespace format = aedat4;

namespace {

constexpr std::string_view signature = "#!AER-DAT4.";
constexpr size_t signature_line = 14; ///< bytes, with its end
constexpr size_t identifier_at = 8;   ///< in a FlatBuffer with its size: size, root, identifier
constexpr size_t largest = size_t{1} << 30U; ///< bytes of a packet: far beyond what a camera gives

[[noreturn]] void fail_file(const fs::path& path, const std::string& what,
                            const std::string& remedy = "copy the file again") {
    throw Error(ExitCode::bad_input, path.string() + ": " + what + "; " + remedy);
}

flatbuffers::Verifier verifier_of(std::span<const uint8_t> bytes) {
    constexpr flatbuffers::uoffset_t deepest = 64;
    return {bytes.data(), bytes.size(), deepest,
            std::numeric_limits<flatbuffers::uoffset_t>::max()};
}

/// None where the bytes are not such a FlatBuffer with its size before it.
template <class Table> const Table* checked(std::span<const uint8_t> bytes, const char* name) {
    auto verifier = verifier_of(bytes);
    return verifier.VerifySizePrefixedBuffer<Table>(name)
               ? flatbuffers::GetSizePrefixedRoot<Table>(bytes.data())
               : nullptr;
}

std::string_view identifier(std::span<const uint8_t> bytes) {
    constexpr size_t length = 4;
    return bytes.size() < identifier_at + length
               ? std::string_view()
               : std::string_view(reinterpret_cast<const char*>(bytes.data()) + identifier_at,
                                  length);
}

} // namespace

/// Undoes the compression that a file's packets and its table have in common.
class Aedat4Stream::Unpacker {
public:
    explicit Unpacker(format::Compression compression) : compression_(compression) {
        LZ4F_dctx* lz4 = nullptr;
        if (LZ4F_isError(LZ4F_createDecompressionContext(&lz4, LZ4F_VERSION)) != 0) {
            throw std::bad_alloc();
        }
        lz4_.reset(lz4);
        zstd_.reset(ZSTD_createDCtx());
        if (!zstd_) {
            throw std::bad_alloc();
        }
    }

    /// None where the bytes are damaged or give more than any packet has.
    std::optional<std::span<const uint8_t>> operator()(std::span<const uint8_t> packed) {
        switch (compression_) {
        case format::Compression_none:
            return packed;
        case format::Compression_lz4:
        case format::Compression_lz4_high:
            LZ4F_resetDecompressionContext(lz4_.get());
            return unpack(packed, [this](std::span<uint8_t> to, std::span<const uint8_t> from) {
                Step step{to.size(), from.size(), false, false};
                const size_t more = LZ4F_decompress(lz4_.get(), to.data(), &step.given, from.data(),
                                                    &step.taken, nullptr);
                step.failed = LZ4F_isError(more) != 0;
                step.ended = more == 0;
                return step;
            });
        default:
            ZSTD_DCtx_reset(zstd_.get(), ZSTD_reset_session_only);
            return unpack(packed, [this](std::span<uint8_t> to, std::span<const uint8_t> from) {
                ZSTD_outBuffer out{to.data(), to.size(), 0};
                ZSTD_inBuffer in{from.data(), from.size(), 0};
                const size_t more = ZSTD_decompressStream(zstd_.get(), &out, &in);
                return Step{out.pos, in.pos, ZSTD_isError(more) != 0, more == 0};
            });
        }
    }

private:
    struct Step {
        size_t given;
        size_t taken;
        bool failed;
        bool ended;
    };

    template <class Next>
    std::optional<std::span<const uint8_t>> unpack(std::span<const uint8_t> packed,
                                                   const Next& next) {
        size_t done = 0;
        for (;;) {
            if (done == bytes_.size()) {
                if (done >= largest) {
                    return std::nullopt;
                }
                bytes_.resize(std::max(2 * done, size_t{1} << 16U));
            }
            const Step step = next(std::span(bytes_).subspan(done), packed);
            done += step.given;
            packed = packed.subspan(step.taken);
            if (step.ended) {
                return std::span<const uint8_t>(bytes_).first(done);
            }
            if (step.failed || (step.given == 0 && step.taken == 0) ||
                (packed.empty() && done < bytes_.size())) {
                return std::nullopt;
            }
        }
    }

    struct Free {
        void operator()(LZ4F_dctx* context) const { LZ4F_freeDecompressionContext(context); }
        void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
    };

    format::Compression compression_;
    std::unique_ptr<LZ4F_dctx, Free> lz4_;
    std::unique_ptr<ZSTD_DCtx, Free> zstd_;
    std::vector<uint8_t> bytes_; ///< keeps its size
};

/// Finds the packets of the wanted stream.
class Aedat4Stream::Finder {
public:
    explicit Finder(Aedat4Stream& owner) : owner_(owner), file_(owner.file_) { read_header(); }

    void find() {
        if (!find_by_table()) {
            find_by_pass();
        }
        owner_.found_ = stream_.has_value();
        if (owner_.kind_ == Kind::events) { // tables count no elements in frames' packets
            std::erase_if(owner_.packets_,
                          [](const Packet& packet) { return packet.elements == 0; });
        }
    }

private:
    void read_header() {
        std::array<uint8_t, signature_line + sizeof(uint32_t)> start{};
        const size_t got = file_.read(0, start);
        if (!is_aedat4(std::span(start).first(got)) || got < start.size()) {
            fail_file(file_.path(), "not an AEDAT 4 file, or ends in its first line");
        }
        // Unlike in packets, the size before the FlatBuffer is not one with it: numbers are aligned
        // from behind it on.
        const auto size = flatbuffers::ReadScalar<uint32_t>(start.data() + signature_line);
        const auto at = static_cast<int64_t>(start.size());
        begin_ = at + size;
        if (begin_ > file_.size()) {
            fail_file(file_.path(), "ends in its header");
        }
        std::vector<uint8_t> bytes(size);
        bytes.resize(file_.read(at, bytes));
        auto verifier = verifier_of(bytes);
        if (!verifier.VerifyBuffer<format::Header>("IOHE")) {
            fail_file(file_.path(), "its header is damaged");
        }
        const auto* header = flatbuffers::GetRoot<format::Header>(bytes.data());
        if (header->compression() < format::Compression_MIN ||
            header->compression() > format::Compression_MAX) {
            fail_file(file_.path(),
                      "has a compression of number " + std::to_string(header->compression()) +
                          ", which is not known",
                      "record it with LZ4 or Zstandard");
        }
        owner_.unpacker_ = std::make_unique<Unpacker>(header->compression());
        table_ = header->table_position();
    }

    /// Whether a stream's packets are wanted, told by its first one.
    bool wanted(int32_t stream, const Packet& first) {
        const auto known = streams_.find(stream);
        if (known != streams_.end()) {
            return known->second;
        }
        const bool fits = identifier(owner_.decompress(first)) ==
                          (owner_.kind_ == Kind::events ? "EVTS" : "FRME");
        if (fits && stream_) {
            fail_file(file_.path(),
                      std::string("holds several streams of ") +
                          (owner_.kind_ == Kind::events ? "events" : "frames"),
                      "export one camera's to a file of its own");
        }
        if (fits) {
            stream_ = stream;
        }
        streams_[stream] = fits;
        return fits;
    }

    /// False where the file has no table, a damaged one, or one of an older version that does not
    /// say what packets of events hold.
    bool find_by_table() {
        if (table_ < begin_ || table_ >= file_.size() ||
            file_.size() - table_ > int64_t{std::numeric_limits<int32_t>::max()}) {
            return false;
        }
        std::vector<uint8_t> packed(static_cast<size_t>(file_.size() - table_));
        packed.resize(file_.read(table_, packed));
        const auto bytes = (*owner_.unpacker_)(packed);
        if (!bytes) {
            return false;
        }
        const std::vector<uint8_t> kept(bytes->begin(), bytes->end()); // packets are unpacked below
        const auto* table = checked<format::PacketTable>(kept, "FTAB");
        if (table == nullptr || table->packets() == nullptr) {
            return false;
        }
        for (const auto* entry : *table->packets()) {
            const auto* header = entry->header();
            if (header == nullptr || header->size() < 0 || entry->position() < begin_ ||
                entry->position() > table_ - header->size()) {
                return false;
            }
            const Packet packet{entry->position(), header->size(), entry->elements(),
                                entry->first_time(), entry->last_time()};
            if (wanted(header->stream(), packet)) {
                owner_.packets_.push_back(packet);
            }
        }
        return owner_.kind_ == Kind::frames ||
               std::ranges::any_of(owner_.packets_,
                                   [](const Packet& packet) { return packet.elements > 0; });
    }

    /// Up to the end, or to a packet that a recording broke off in.
    void find_by_pass() {
        owner_.packets_.clear();
        streams_.clear();
        stream_.reset();
        int64_t at = begin_;
        std::array<uint8_t, sizeof(format::PacketHeader)> header{};
        const int64_t end = table_ >= begin_ ? std::min(table_, file_.size()) : file_.size();
        while (at + int64_t{sizeof(header)} <= end) {
            (void)file_.read(at, header);
            const auto stream = flatbuffers::ReadScalar<int32_t>(header.data());
            Packet packet;
            packet.position = at + int64_t{sizeof(header)};
            packet.size = flatbuffers::ReadScalar<int32_t>(header.data() + sizeof(stream));
            if (packet.size < 0 || packet.position > end - packet.size) {
                break;
            }
            if (wanted(stream, packet)) {
                describe(packet);
                owner_.packets_.push_back(packet);
            }
            at = packet.position + packet.size;
        }
    }

    /// What the table would say.
    void describe(Packet& packet) const {
        const auto bytes = owner_.unpack(packet);
        if (owner_.kind_ == Kind::frames) {
            packet.first_time = packet.last_time =
                flatbuffers::GetSizePrefixedRoot<format::Frame>(bytes.data())->time();
            return;
        }
        const auto* events =
            flatbuffers::GetSizePrefixedRoot<format::EventPacket>(bytes.data())->events();
        if (events != nullptr && events->size() > 0) {
            packet.elements = events->size();
            packet.first_time = events->Get(0)->time();
            packet.last_time = events->Get(events->size() - 1)->time();
        }
    }

    Aedat4Stream& owner_;
    const FileReader& file_;
    int64_t begin_ = 0;  ///< of the first packet
    int64_t table_ = -1; ///< of the table
    std::map<int32_t, bool> streams_;
    std::optional<int32_t> stream_;
};

bool is_aedat4(std::span<const uint8_t> start) {
    return start.size() >= signature.size() &&
           std::equal(signature.begin(), signature.end(), start.begin());
}

Aedat4Stream::Aedat4Stream(const fs::path& path, Kind kind) : file_(path), kind_(kind) {
    Finder(*this).find();
}

Aedat4Stream::~Aedat4Stream() = default;

std::span<const uint8_t> Aedat4Stream::decompress(const Packet& packet) {
    packed_.resize(static_cast<size_t>(packet.size));
    if (file_.read(packet.position, packed_) < packed_.size()) {
        fail(packet, "is cut off");
    }
    const auto bytes = (*unpacker_)(packed_);
    if (!bytes) {
        fail(packet, "cannot be decompressed");
    }
    return *bytes;
}

std::span<const uint8_t> Aedat4Stream::unpack(const Packet& packet) {
    const auto bytes = decompress(packet);
    const bool good = kind_ == Kind::events ? checked<format::EventPacket>(bytes, "EVTS") != nullptr
                                            : checked<format::Frame>(bytes, "FRME") != nullptr;
    if (!good) {
        fail(packet, "is damaged");
    }
    return bytes;
}

void Aedat4Stream::fail(const Packet& packet, const std::string& what) const {
    fail_file(file_.path(), "the packet at byte " + std::to_string(packet.position) + " " + what);
}

} // namespace ecir::io
