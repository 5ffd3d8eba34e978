// Bilinear fetches from an image whose samples lie at whole coordinates 0 ... last, the border's value
// outside.

struct Neighbours {
    uvec2 at;   // upper left
    uvec2 next; // lower right
    vec2 share; // of `next`
};

// Precondition: `position` is a number: a NaN could lead anywhere.
Neighbours neighbours(vec2 position, vec2 last) {
    const vec2 place = clamp(position, vec2(0), last);
    const vec2 low = floor(place);
    return Neighbours(uvec2(low), uvec2(min(low + 1, last)), place - low);
}

// No more than half a sample beyond the outer ones.
bool is_inside(vec2 position, vec2 last) {
    return all(greaterThanEqual(position, vec2(-0.5))) && all(lessThanEqual(position, last + 0.5));
}
