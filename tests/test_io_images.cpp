#include <array>
#include <cmath>
#include <cstdint>
#include <doctest/doctest.h>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "tests/test_io_support.hpp"
#include "tools/io/frames.hpp"
#include "tools/io/image.hpp"
#include "tools/io/npy.hpp"

using namespace ecir;
using namespace ecir::test;

namespace {

io::Image pattern(int width, int height, int channels, int bits) {
    io::Image image{width, height, channels, bits, {}};
    const int levels = bits == 8 ? 255 : 65535;
    const auto count = static_cast<size_t>(width * height * channels);
    for (size_t i = 0; i < count; ++i) {
        const auto stored = static_cast<int>((i * 7919 + 13) % static_cast<size_t>(levels + 1));
        image.pixels.push_back(static_cast<float>(stored) / static_cast<float>(levels));
    }
    return image;
}

void check_round_trip(const std::string& name, int channels, int bits) {
    const TemporaryFolder folder;
    const io::Image image = pattern(37, 21, channels, bits);
    io::write_image(folder / name, image);
    const io::Image again = io::read_image(folder / name);
    CHECK(again.width == 37);
    CHECK(again.height == 21);
    CHECK(again.channels == channels);
    CHECK(again.bits == bits);
    CHECK(again.pixels == image.pixels);
}

/// Uncompressed 8-bit grey TIFF of 16 x 16 with the directory before the pixels, so that a
/// truncated copy still has all its tags.
std::string tiff_directory_first() {
    std::string bytes("II*\0\10\0\0\0", 8);
    const auto add16 = [&](unsigned v) {
        bytes += static_cast<char>(v & 0xffU);
        bytes += static_cast<char>(v >> 8U);
    };
    const auto tag = [&](unsigned id, unsigned value) {
        add16(id);
        add16(4); // LONG
        add16(1);
        add16(0);
        add16(value);
        add16(0);
    };
    add16(9);
    tag(256, 16);  // width
    tag(257, 16);  // height
    tag(258, 8);   // bits
    tag(259, 1);   // no compression
    tag(262, 1);   // black is 0
    tag(273, 122); // where the pixels start: 8 + 2 + 9 * 12 + 4
    tag(277, 1);   // channels
    tag(278, 16);  // rows a strip
    tag(279, 256); // bytes of the strip
    add16(0);
    add16(0);
    for (int i = 0; i < 256; ++i) {
        bytes += static_cast<char>(i);
    }
    return bytes;
}

} // namespace

TEST_SUITE("io") {

    TEST_CASE("images: 8-bit grey PNG comes back as written") {
        check_round_trip("a.png", 1, 8);
    }
    TEST_CASE("images: 8-bit colour PNG comes back as written") {
        check_round_trip("a.png", 3, 8);
    }
    TEST_CASE("images: 16-bit grey PNG comes back as written") {
        check_round_trip("a.png", 1, 16);
    }
    TEST_CASE("images: 16-bit colour PNG comes back as written") {
        check_round_trip("a.png", 3, 16);
    }
    TEST_CASE("images: 8-bit colour TIFF comes back as written") {
        check_round_trip("a.tif", 3, 8);
    }
    TEST_CASE("images: 16-bit grey TIFF comes back as written") {
        check_round_trip("a.TIFF", 1, 16);
    }

    TEST_CASE("images: colours are in RGB order") {
        const TemporaryFolder folder;
        for (const auto* name : {"a.png", "a.tif", "a.jpg"}) {
            // OpenCV's order is BGR: this is red.
            cv::imwrite(folder / name, cv::Mat(16, 16, CV_8UC3, cv::Scalar(0, 0, 255)));
            const io::Image image = io::read_image(folder / name);
            REQUIRE(image.channels == 3);
            CHECK(image.pixels[0] > 0.98F);
            CHECK(image.pixels[1] < 0.02F);
            CHECK(image.pixels[2] < 0.02F);
            io::write_image(folder / name, image);
            const auto stored = cv::imread(folder / name).at<cv::Vec3b>(3, 3);
            CHECK(stored[2] > 250);
            CHECK(stored[0] < 5);
        }
    }

    TEST_CASE("images: alpha is dropped") {
        const TemporaryFolder folder;
        cv::imwrite(folder / "a.png", cv::Mat(5, 4, CV_8UC4, cv::Scalar(10, 20, 30, 0)));
        const io::Image image = io::read_image(folder / "a.png");
        REQUIRE(image.channels == 3);
        CHECK(image.pixels.size() == 60);
        CHECK(image.pixels[0] == 30.0F / 255.0F);
        CHECK(image.pixels[2] == 10.0F / 255.0F);
    }

    TEST_CASE("images: grey JPEG has one channel") {
        const TemporaryFolder folder;
        cv::imwrite(folder / "a.jpg", cv::Mat(20, 20, CV_8UC1, cv::Scalar(100)));
        const io::Image image = io::read_image(folder / "a.jpg");
        CHECK(image.channels == 1);
        CHECK(image.bits == 8);
        CHECK(std::abs(image.pixels[0] - 100.0F / 255.0F) < 0.01F);
    }

    TEST_CASE("images: values are clipped and rounded, NaN is black") {
        const TemporaryFolder folder;
        const float nan = std::numeric_limits<float>::quiet_NaN();
        io::write_image(folder / "a.png", {5, 1, 1, 8, {-0.5F, 1.5F, nan, 0.4F / 255, 0.6F / 255}});
        const io::Image image = io::read_image(folder / "a.png");
        CHECK(image.pixels == std::vector<float>{0, 1, 0, 0, 1.0F / 255});
    }

    TEST_CASE("images: a single pixel and a single row") {
        const TemporaryFolder folder;
        io::write_image(folder / "a.png", pattern(1, 1, 1, 8));
        io::write_image(folder / "b.png", pattern(99, 1, 3, 16));
        CHECK(io::read_image(folder / "a.png").pixels.size() == 1);
        CHECK(io::read_image(folder / "b.png").pixels == pattern(99, 1, 3, 16).pixels);
    }

    TEST_CASE("images: truncated PNG, JPEG and TIFF are errors") {
        const TemporaryFolder folder;
        for (const std::string extension : {".png", ".jpg", ".tif"}) {
            io::write_image(folder / ("whole" + extension), pattern(64, 48, 3, 8));
            for (const double share : {0.995, 0.9, 0.5, 0.1}) {
                CAPTURE(extension);
                CAPTURE(share);
                const auto cut = truncate(folder / ("whole" + extension), folder / "cut", share);
                check_error(
                    ExitCode::bad_input, [&] { io::read_image(cut); }, cut.string(), "truncated",
                    "copy");
            }
        }
    }

    TEST_CASE("images: truncated TIFF with its directory in front is an error") {
        const TemporaryFolder folder;
        const auto whole = put(folder / "a.tif", tiff_directory_first());
        const io::Image image = io::read_image(whole);
        CHECK(image.pixels[255] == 1.0F);
        const auto cut = truncate(whole, folder / "cut.tif", 0.8);
        check_error(
            ExitCode::bad_input, [&] { io::read_image(cut); }, cut.string(), "truncated");
    }

    TEST_CASE("images: JPEG with data after its end is read, and cut within it is not") {
        const TemporaryFolder folder;
        io::write_image(folder / "a.jpg", pattern(40, 40, 3, 8));
        const std::string bytes = get(folder / "a.jpg");
        CHECK(io::read_image(put(folder / "b.jpg", bytes + "appended")).width == 40);
        // An end marker inside a segment, as a thumbnail has one, does not count.
        const std::string thumbnail("\xff\xe1\x00\x06\xff\xd9\xff\xd9", 8);
        const std::string with = bytes.substr(0, 2) + thumbnail + bytes.substr(2);
        CHECK(io::read_image(put(folder / "c.jpg", with)).width == 40);
        const auto cut = put(folder / "d.jpg", with.substr(0, with.size() / 2));
        check_error(
            ExitCode::bad_input, [&] { io::read_image(cut); }, "truncated");
    }

    TEST_CASE("images: PNG with flipped bits is an error") {
        const TemporaryFolder folder;
        io::write_image(folder / "a.png", pattern(64, 48, 1, 8));
        std::string bytes = get(folder / "a.png");
        bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 0x55);
        const auto path = put(folder / "b.png", bytes);
        check_error(
            ExitCode::bad_input, [&] { io::read_image(path); }, path.string(), "damaged");
    }

    TEST_CASE("images: missing, empty, of another kind, or a folder") {
        const TemporaryFolder folder;
        check_error(
            ExitCode::bad_input, [&] { io::read_image(folder / "no.png"); }, "no.png",
            "No such file");
        check_error(
            ExitCode::bad_input, [&] { io::read_image(put(folder / "e.png", "")); }, "e.png",
            "empty");
        check_error(
            ExitCode::bad_input, [&] { io::read_image(put(folder / "t.png", "GIF89a")); }, "t.png",
            "convert");
        check_error(
            ExitCode::bad_input, [&] { io::read_image(folder.path()); }, "folder");
    }

    TEST_CASE("images: floating-point TIFF is an error that names the depth") {
        const TemporaryFolder folder;
        cv::imwrite(folder / "f.tif", cv::Mat(8, 8, CV_32FC1, cv::Scalar(0.5)));
        check_error(
            ExitCode::bad_input, [&] { io::read_image(folder / "f.tif"); }, "f.tif", "32F");
    }

    TEST_CASE("images: what cannot be written is refused") {
        const TemporaryFolder folder;
        const io::Image image = pattern(4, 4, 1, 16);
        check_error(
            ExitCode::bad_input, [&] { io::write_image(folder / "a.jpg", image); }, "JPEG");
        check_error(
            ExitCode::bad_input, [&] { io::write_image(folder / "a.xyz", image); }, ".xyz");
        check_error(
            ExitCode::bad_input, [&] { io::write_image(folder / "no/a.png", image); }, "no/");
        const io::Image wrong{4, 4, 1, 8, {1.0F}};
        check_error(
            ExitCode::bad_input, [&] { io::write_image(folder / "a.png", wrong); }, "4 x 4");
        CHECK(folder.empty());
    }

    TEST_CASE("images: a full disk is exit 5") {
        const TemporaryFolder folder;
        std::filesystem::create_symlink("/dev/full", folder / "full.png");
        check_error(
            ExitCode::resources,
            [&] { io::write_image(folder / "full.png", pattern(64, 64, 1, 8)); }, "full.png",
            "space");
        std::filesystem::create_symlink("/dev/full", folder / "full.npy");
        const std::array<size_t, 1> shape = {2};
        const std::array<float, 2> values = {1, 2};
        check_error(
            ExitCode::resources, [&] { io::write_npy(folder / "full.npy", shape, values); },
            "full.npy", "space");
    }

    TEST_CASE("npy: arrays come back as written, unclipped") {
        const TemporaryFolder folder;
        for (const std::vector<size_t>& shape :
             {std::vector<size_t>{2, 3, 4}, {24}, {24, 1}, {1, 2, 2, 2, 3}}) {
            std::vector<float> values(24);
            for (size_t i = 0; i < values.size(); ++i) {
                values[i] = static_cast<float>(i) * 1.7F - 20.0F;
            }
            io::write_npy(folder / "a.npy", shape, values);
            bool integer = true;
            const io::Array array = io::read_npy(folder / "a.npy", &integer);
            CHECK(array.shape == shape);
            CHECK(array.values == values);
            CHECK_FALSE(integer);
            CHECK((get(folder / "a.npy").size() - 96) % 64 == 0); // values are aligned
        }
    }

    namespace {
    std::string npy(const std::string& header, const std::string& data) {
        std::string bytes("\x93NUMPY\x01\x00", 8);
        bytes += static_cast<char>(header.size());
        bytes += '\0';
        return bytes + header + data;
    }
    } // namespace

    TEST_CASE("npy: other element types") {
        const TemporaryFolder folder;
        bool integer = false;
        const auto bytes = put(folder / "u1.npy", npy("{'descr': '|u1', 'fortran_order': False, "
                                                      "'shape': (2,), }\n",
                                                      "\x07\xff"));
        CHECK(io::read_npy(bytes, &integer).values == std::vector<float>{7, 255});
        CHECK(integer);
        const auto words = put(folder / "u2.npy", npy("{'descr': '<u2', 'fortran_order': False, "
                                                      "'shape': (1, 1), }\n",
                                                      "\x01\x02"));
        CHECK(io::read_npy(words).values == std::vector<float>{513});
        const double value = 0.125;
        const auto doubles =
            put(folder / "f8.npy", npy("{'shape':(), 'fortran_order':False, 'descr':'<f8'}\n",
                                       {reinterpret_cast<const char*>(&value), sizeof value}));
        CHECK(io::read_npy(doubles, &integer).values == std::vector<float>{0.125F});
        CHECK_FALSE(integer);
    }

    TEST_CASE("npy: damaged or unsuitable files are errors") {
        const TemporaryFolder folder;
        const auto read = [&](const std::string& header, const std::string& data) {
            return [=, &folder] { io::read_npy(put(folder / "a.npy", npy(header, data))); };
        };
        check_error(ExitCode::bad_input,
                    read("{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }\n", "1234567"),
                    "a.npy", "7 bytes", "truncated");
        check_error(ExitCode::bad_input,
                    read("{'descr': '<i8', 'fortran_order': False, 'shape': (0,), }\n", ""), "<i8");
        check_error(ExitCode::bad_input,
                    read("{'descr': '<f4', 'fortran_order': True, 'shape': (1, 1), }\n", "1234"),
                    "Fortran");
        check_error(ExitCode::bad_input,
                    read("{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, "
                         "4294967296, 2), }\n",
                         "1234"),
                    "too large");
        check_error(ExitCode::bad_input, read("{}\n", ""), "shape");
        check_error(
            ExitCode::bad_input, [&] { io::read_npy(put(folder / "b.npy", "PK")); }, "b.npy");
        const auto cut = put(folder / "c.npy", npy("{'descr': '<f4'", "").substr(0, 20));
        check_error(
            ExitCode::bad_input, [&] { io::read_npy(cut); }, "header");
    }

    TEST_CASE("frames: a folder is read in the order of its names, other files left out") {
        const TemporaryFolder folder;
        for (const size_t i : {2U, 0U, 1U}) {
            io::write_image(folder / io::frame_name(i),
                            {1, 1, 1, 16, {static_cast<float>(i) / 65535.0F}});
        }
        put(folder / "frames.csv", "");
        put(folder / ".000009.png", "");
        const auto frames = io::read_frames(folder.path());
        REQUIRE(frames.size() == 3);
        CHECK(frames[2].pixels[0] == 2.0F / 65535.0F);
        CHECK(frames[2].bits == 16);
    }

    TEST_CASE("frames: mixed sizes, no images, no folder") {
        const TemporaryFolder folder;
        check_error(
            ExitCode::bad_input, [&] { io::read_frames(folder.path()); }, "no images");
        check_error(
            ExitCode::bad_input, [&] { io::read_frames(folder / "none"); }, "none");
        io::write_image(folder / "0.png", pattern(4, 4, 1, 8));
        io::write_image(folder / "1.png", pattern(4, 5, 1, 8));
        check_error(
            ExitCode::bad_input, [&] { io::read_frames(folder.path()); }, "1.png", "4 x 5");
    }

    TEST_CASE("frames: frames.csv restores the times exactly") {
        const TemporaryFolder folder;
        const Exposure exposure{1615007563376030, 1615007563480031};
        std::vector<io::FrameTime> frames;
        for (const double t : {-1.0, 1.0 / 3.0, 1.0, 0.0}) {
            frames.push_back({io::frame_name(frames.size()), t, io::absolute_time(exposure, t)});
        }
        io::write_frames_csv(folder / "frames.csv", frames);
        const std::string text = get(folder / "frames.csv");
        CHECK(text == "file,t_normalised,t_us\n"
                      "000000.png,-1,1615007563376030\n"
                      "000001.png,0.3333333333333333,1615007563445364\n"
                      "000002.png,1,1615007563480031\n"
                      "000003.png,0,1615007563428030.5\n");
    }

} // TEST_SUITE
