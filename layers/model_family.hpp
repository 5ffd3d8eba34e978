#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "layers/scene_facts.hpp"

namespace ecir {

/// How much accuracy may be given up for speed.
enum class Quality {
    fast,     ///< the smallest model, whatever the scene
    balanced, ///< the smallest that loses at most 0.5 dB
    best,     ///< the smallest that loses at most 0.1 dB
};

/// Models of one kind in several sizes, smallest first, and how much accuracy each loses against
/// the largest by how much a scene has of what they differ in. Read from weights/family.json, which
/// tools/benchmark/family measures and writes.
class ModelFamily {
public:
    struct Loss {
        double events_per_pixel;
        double db; ///< PSNR of the largest member minus that of this one, mean over scenes like it
    };
    struct Member {
        std::string model;
        std::vector<Loss> loss; ///< ascending in events_per_pixel; empty for the largest
    };

    /// Throws Error(bad_input) naming the file and what is wrong in it.
    explicit ModelFamily(const std::filesystem::path& file);

    /// That of the shipped models.
    static ModelFamily shipped();

    [[nodiscard]] const std::vector<Member>& members() const { return members_; }

    /// Of a member for a scene, between the points measured by the logarithm of their events a
    /// pixel, beyond them as at the nearest.
    [[nodiscard]] double loss(size_t member, const SceneFacts& facts) const;

    /// The smallest of the first `count` members whose loss the quality allows, else the last of
    /// them.
    [[nodiscard]] size_t choose(const SceneFacts& facts, Quality quality, size_t count) const;

private:
    std::vector<Member> members_;
};

} // namespace ecir
