#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace ecir {

/// How much accuracy may be given up for speed.
enum class Quality {
    fast,     ///< the smallest model, whatever the scene
    balanced, ///< the smallest that loses at most 0.5 dB in scenes like it
    best,     ///< the smallest that loses at most 0.1 dB in scenes like it
};

/// "fast", "balanced" or "best".
const char* quality_name(Quality quality);

/// Models of one kind in several sizes, smallest first, and how much accuracy each loses against
/// the largest, by the events a pixel that a scene has: what there is to tell apart. Read from
/// weights/family.json, which tools/benchmark/family measures and writes.
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

    /// Of a member for a scene with so many events a pixel of what moves, between the points
    /// measured by the logarithm, beyond them as at the nearest.
    [[nodiscard]] double loss(size_t member, double events_per_pixel) const;

    /// The smallest of the first `count` members whose loss against the last of them the quality
    /// allows.
    [[nodiscard]] size_t choose(double events_per_pixel, Quality quality, size_t count) const;

private:
    std::vector<Member> members_;
};

} // namespace ecir
