#pragma once
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <lz4frame.h>
#include <string>
#include <utility>
#include <vector>
#include <zstd.h>

#include "aedat4_generated.h"
#include "tests/test_io_support.hpp"

namespace ecir::test {

namespace format = aedat4;

/// Writes AEDAT 4 as the format's description has it, for tests.
class Aedat4Writer {
public:
    explicit Aedat4Writer(format::Compression compression = format::Compression_lz4)
        : compression_(compression) {}

    /// Events `first` to `last` - 1 as one packet of a stream.
    void events(const EventView& events, size_t first, size_t last, int32_t stream = 0) {
        std::vector<format::Event> packed;
        for (size_t i = first; i < last; ++i) {
            packed.emplace_back(events.t[i], static_cast<int16_t>(events.x[i]),
                                static_cast<int16_t>(events.y[i]), events.p[i] != 0);
        }
        flatbuffers::FlatBufferBuilder builder;
        const auto vector = builder.CreateVectorOfStructs(packed);
        builder.FinishSizePrefixed(format::CreateEventPacket(builder, vector), "EVTS");
        const bool any = last > first;
        add(builder, stream, last - first, any ? events.t[first] : 0, any ? events.t[last - 1] : 0);
    }

    /// `edit` may change what is written.
    template <class Edit>
    void frame(const Exposure& exposure, int width, int height, const std::vector<uint8_t>& pixels,
               const Edit& edit, int32_t stream = 1) {
        flatbuffers::FlatBufferBuilder builder;
        const auto vector = builder.CreateVector(pixels);
        const int64_t middle = exposure.start + exposure.duration() / 2;
        format::FrameBuilder frame(builder);
        frame.add_time(middle);
        frame.add_width(static_cast<int16_t>(width));
        frame.add_height(static_cast<int16_t>(height));
        frame.add_pixels(vector);
        edit(frame);
        builder.FinishSizePrefixed(frame.Finish(), "FRME");
        add(builder, stream, 0, middle, middle); // no elements, as the camera's software has it
    }
    void frame(const Exposure& exposure, int width, int height,
               const std::vector<uint8_t>& pixels) {
        frame(exposure, width, height, pixels, [&](format::FrameBuilder& frame) {
            frame.add_exposure_start(exposure.start);
            frame.add_exposure_end(exposure.end);
        });
    }

    /// Without a table the recording looks as if it had not been ended.
    std::filesystem::path write(const std::filesystem::path& path, bool table = true) {
        // The position's own digits do not change the header's size.
        const size_t begin = head(0).size();
        const auto end = static_cast<int64_t>(begin + body_.size());
        flatbuffers::FlatBufferBuilder builder;
        std::vector<flatbuffers::Offset<format::PacketEntry>> entries;
        for (const Entry& entry : entries_) {
            const format::PacketHeader header(entry.stream, entry.size);
            entries.push_back(
                format::CreatePacketEntry(builder, static_cast<int64_t>(begin) + entry.position,
                                          &header, entry.elements, entry.first, entry.last));
        }
        const auto vector = builder.CreateVector(entries);
        builder.FinishSizePrefixed(format::CreatePacketTable(builder, vector), "FTAB");
        return put(path, head(table ? end : -1) + body_ +
                             (table ? compress({builder.GetBufferPointer(), builder.GetSize()})
                                    : std::string()));
    }

    struct Entry {
        int32_t stream;
        int32_t size;
        int64_t position; ///< from the first packet's header on
        int64_t elements;
        int64_t first;
        int64_t last;
    };
    /// What the table will say.
    std::vector<Entry>& entries() { return entries_; }

private:
    void add(const flatbuffers::FlatBufferBuilder& builder, int32_t stream, size_t elements,
             int64_t first, int64_t last) {
        const std::string packet = compress({builder.GetBufferPointer(), builder.GetSize()});
        const auto size = static_cast<int32_t>(packet.size());
        body_.append(reinterpret_cast<const char*>(&stream), sizeof(stream));
        body_.append(reinterpret_cast<const char*>(&size), sizeof(size));
        entries_.push_back({stream, size, static_cast<int64_t>(body_.size()),
                            static_cast<int64_t>(elements), first, last});
        body_ += packet;
    }

    [[nodiscard]] std::string compress(std::span<const uint8_t> bytes) const {
        std::string out;
        switch (compression_) {
        case format::Compression_none:
            out.assign(bytes.begin(), bytes.end());
            break;
        case format::Compression_lz4:
        case format::Compression_lz4_high:
            out.resize(LZ4F_compressFrameBound(bytes.size(), nullptr));
            out.resize(
                LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), nullptr));
            break;
        default:
            out.resize(ZSTD_compressBound(bytes.size()));
            out.resize(ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), 1));
        }
        return out;
    }

    [[nodiscard]] std::string head(int64_t table) const {
        flatbuffers::FlatBufferBuilder builder;
        const auto description = builder.CreateString("<dv version=\"2.0\"></dv>\n");
        format::HeaderBuilder header(builder);
        builder.ForceDefaults(true);
        header.add_compression(compression_);
        header.add_table_position(table);
        header.add_description(description);
        builder.Finish(header.Finish(), "IOHE");
        const uint32_t size = builder.GetSize();
        std::string out = "#!AER-DAT4.0\r\n";
        out.append(reinterpret_cast<const char*>(&size), sizeof(size));
        out.append(reinterpret_cast<const char*>(builder.GetBufferPointer()), size);
        return out;
    }

    format::Compression compression_;
    std::string body_;
    std::vector<Entry> entries_;
};

} // namespace ecir::test
