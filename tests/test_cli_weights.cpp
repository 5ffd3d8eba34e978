#include <cstring>
#include <doctest/doctest.h>
#include <functional>
#include <nlohmann/json.hpp>

#include "tests/cli_support.hpp"

using namespace ecir;
using namespace ecir::test;
using nlohmann::json;

namespace {

constexpr const char* kTensor = "unet.en_conv1.0.weight";

fs::path shipped() {
    return fs::path(ECIR_TEST_DATA) / "../weights/ecir.safetensors";
}

/// The shipped weights with another header; the data stays where it is.
fs::path edited(const std::string& name, const std::function<void(json&)>& edit) {
    const std::string all = get(shipped());
    uint64_t length = 0;
    std::memcpy(&length, all.data(), sizeof length);
    const std::string data = all.substr(sizeof length + length);
    json header = json::parse(all.substr(sizeof length, length));
    edit(header);
    const std::string text = header.dump();
    length = text.size();
    const std::string front(reinterpret_cast<const char*>(&length), sizeof length);
    return put(Scene::get().folder / name, front + text + data);
}

void refused(const fs::path& file, std::initializer_list<std::string> parts) {
    const Scene& scene = Scene::get();
    const auto before = names(scene.results);
    must_fail(3, scene.deblur(scene.result("no"), {"-m", file.string()}), parts);
    CHECK(names(scene.results) == before);
}

} // namespace

TEST_SUITE("cli weights") {
    TEST_CASE("a weights file that is damaged as a whole is named") {
        const Scene& scene = Scene::get();
        refused("nosuch.safetensors", {"nosuch.safetensors"});
        refused(put(scene.folder / "empty.safetensors", ""), {"empty.safetensors"});
        refused(put(scene.folder / "noise.safetensors", std::string(100, 'x')),
                {"noise.safetensors"});
        refused(truncate(shipped(), scene.folder / "start.safetensors", 1e-4),
                {"start.safetensors", "truncated"});
    }

    TEST_CASE("truncated data names a tensor that it lacks") {
        refused(truncate(shipped(), Scene::get().folder / "half.safetensors", 0.5),
                {"half.safetensors", "tensor '", "truncated"});
    }

    TEST_CASE("a tensor that is missing, of another shape, dtype or offset is named") {
        must(Scene::get().deblur(
            Scene::get().result("intact.npy"),
            {"--frames", "1", "-m", edited("intact.safetensors", [](json&) {}).string()}));
        refused(edited("missing.safetensors", [](json& header) { header.erase(kTensor); }),
                {"missing.safetensors", kTensor});
        refused(edited("shape.safetensors",
                       [](json& header) {
                           auto& shape = header[kTensor]["shape"];
                           std::swap(shape[1], shape[2]);
                       }),
                {"shape.safetensors", kTensor, "shape"});
        refused(edited("size.safetensors",
                       [](json& header) {
                           header[kTensor]["shape"][0] = header[kTensor]["shape"][0].get<int>() + 1;
                       }),
                {"size.safetensors", kTensor});
        refused(edited("dtype.safetensors", [](json& header) { header[kTensor]["dtype"] = "I64"; }),
                {"dtype.safetensors", kTensor, "I64"});
        refused(edited("offset.safetensors",
                       [](json& header) {
                           for (auto& offset : header[kTensor]["data_offsets"]) {
                               offset = offset.get<uint64_t>() + 1'000'000'000;
                           }
                       }),
                {"offset.safetensors", kTensor, "offsets"});
        refused(edited("reversed.safetensors",
                       [](json& header) {
                           auto& offsets = header[kTensor]["data_offsets"];
                           std::swap(offsets[0], offsets[1]);
                       }),
                {"reversed.safetensors", kTensor, "offsets"});
    }

    TEST_CASE("metadata that does not fit is named") {
        refused(edited("model.safetensors",
                       [](json& header) { header["__metadata__"]["model"] = "other"; }),
                {"model.safetensors", "'other'"});
        refused(edited("keys.safetensors",
                       [](json& header) { header["__metadata__"].erase("keypoints"); }),
                {"keys.safetensors", "keypoints"});
        refused(edited("variant.safetensors",
                       [](json& header) { header["__metadata__"]["variant"] = "third"; }),
                {"variant.safetensors", "variant"});
    }
}
