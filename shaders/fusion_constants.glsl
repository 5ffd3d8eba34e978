// Numbers that the kernels of the fusion network share. C++ reads this file too: layers/prior.cpp
// checks them against those of the host.

const uint ANCHORS = 9;           // frames of the prior, evenly over the exposure
const uint GAPS = 8;              // between neighbouring anchors
const uint WINDOWS = 32;          // of the motion, evenly over the exposure
const uint WINDOWS_A_GAP = 4;     // from an anchor to the next
const uint CELL = 8;              // pixels a side of a cell of the motion
const float GAP = 2.0 / float(GAPS); // normalised time from an anchor to the next

// Words of an instant (layers/instant.hpp).
const uint INSTANT_TIME = 0;
const uint INSTANT_PLACE = 1;
const uint INSTANT_BELOW = 2;
const uint INSTANT_RANKS = 3; // the first
const uint INSTANT_SHARE = 12;

// Channels of the head's input.
const uint PLANE_PRIOR = 0;
const uint PLANE_BLURRY = 1;
const uint PLANE_DIFFERENCES = 2; // the first, one an anchor
const uint PLANE_SURFACES = 11;   // the first of 4
const uint PLANE_TIME = 15;
