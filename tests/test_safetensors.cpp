#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <unistd.h>

#include "runtime/error.hpp"
#include "weights/safetensors.hpp"

namespace {

namespace fs = std::filesystem;
using ecir::SafeTensors;

/// A file with this header and these data bytes, removed at the end.
class File {
public:
    File(const std::string& header, size_t data_bytes, int64_t claimed = -1)
        : path_(fs::temp_directory_path() /
                ("ecir-test-" + std::to_string(getpid()) + ".safetensors")) {
        std::ofstream out(path_, std::ios::binary);
        const uint64_t size = claimed < 0 ? header.size() : static_cast<uint64_t>(claimed);
        out.write(reinterpret_cast<const char*>(&size), sizeof(size));
        out << header << std::string(data_bytes, '\0');
    }
    ~File() { fs::remove(path_); }
    File(const File&) = delete;
    File& operator=(const File&) = delete;
    [[nodiscard]] const fs::path& path() const { return path_; }

private:
    fs::path path_;
};

/// The message with which reading fails; empty if it does not.
std::string message(const File& file) {
    try {
        const SafeTensors read(file.path());
    } catch (const ecir::Error& error) {
        CHECK(error.code() == ecir::ExitCode::bad_input);
        CHECK(std::string(error.what()).find(file.path().string()) != std::string::npos);
        return error.what();
    }
    return {};
}

bool mentions(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

const char* const kGood = R"({"a.weight":{"dtype":"F32","shape":[2,3],"data_offsets":[0,24]},)"
                          R"("b":{"dtype":"F16","shape":[4],"data_offsets":[24,32]},)"
                          R"("__metadata__":{"model":"ecir","keypoints":"10"}})";

} // namespace

TEST_SUITE("safetensors") {
    TEST_CASE("tensors, shapes and metadata are read") {
        const File file(kGood, 32);
        const SafeTensors read(file.path());
        CHECK(read.get("a.weight").shape == std::vector<uint32_t>{2, 3});
        CHECK(read.get("b").values.size() == 4);
        CHECK(read.meta("model") == "ecir");
        CHECK(read.meta_count("keypoints", 2, 20) == 10);
        CHECK(read.meta("span", "1") == "1");
        CHECK_THROWS_AS((void)read.meta("variant"), ecir::Error);
        CHECK_THROWS_AS((void)read.meta_count("keypoints", 11, 20), ecir::Error);
        CHECK_THROWS_AS((void)read.get("a.weight", {3, 2}), ecir::Error);
        CHECK_THROWS_AS((void)read.get("c"), ecir::Error);
    }

    TEST_CASE("damaged files are refused with the tensor's name") {
        CHECK(mentions(message({kGood, 30}), "'b'"));
        CHECK(mentions(message({kGood, 0}), "truncated"));
        CHECK(mentions(message({"", 0}), "JSON"));
        CHECK(mentions(message({kGood, 32, 1 << 30}), "truncated"));
        CHECK(mentions(message({kGood, 32, INT64_MAX}), "truncated"));
        CHECK(mentions(message({"[1,2]", 0}), "JSON"));
        CHECK(mentions(message({R"({"a":{"dtype":"I64","shape":[1],"data_offsets":[0,8]}})", 8}),
                       "I64"));
        CHECK(mentions(message({R"({"a":{"dtype":"F32","shape":[3],"data_offsets":[0,8]}})", 8}),
                       "'a'"));
        CHECK(mentions(message({R"({"a":{"dtype":"F32","shape":[2],"data_offsets":[8,0]}})", 8}),
                       "'a'"));
        CHECK(mentions(message({R"({"a":{"dtype":"F32","shape":[-2],"data_offsets":[0,8]}})", 8}),
                       "'a'"));
        CHECK(mentions(message({R"({"a":{"dtype":"F32","shape":[4000000000,4000000000,4000000000],)"
                                R"("data_offsets":[0,8]}})",
                                8}),
                       "'a'"));
        CHECK(mentions(message({R"({"a":{"dtype":"F32"}})", 8}), "'a'"));
        CHECK(mentions(message({R"({"a":7})", 8}), "'a'"));
        CHECK(mentions(message({R"({"__metadata__":{"model":7}})", 8}), "model"));
        CHECK(mentions(message({R"({"__metadata__":7})", 8}), "metadata"));
    }

    TEST_CASE("a missing file and a folder are refused") {
        CHECK_THROWS_AS(SafeTensors("/no/such/file.safetensors"), ecir::Error);
        CHECK_THROWS_AS(SafeTensors{fs::temp_directory_path()}, ecir::Error);
    }

    TEST_CASE("float16 widens exactly") {
        CHECK(ecir::half_to_float(0x0000) == 0.0F);
        CHECK(std::signbit(ecir::half_to_float(0x8000)));
        CHECK(ecir::half_to_float(0x3c00) == 1.0F);
        CHECK(ecir::half_to_float(0xc000) == -2.0F);
        CHECK(ecir::half_to_float(0x0001) == 0x1p-24F);
        CHECK(ecir::half_to_float(0x7bff) == 65504.0F);
        CHECK(std::isinf(ecir::half_to_float(0x7c00)));
        CHECK(std::isnan(ecir::half_to_float(0x7e00)));
    }
}
