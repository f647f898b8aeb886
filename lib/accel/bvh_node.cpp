// Nodes to boxes.
#include "accel/bvh_build.h"

namespace gpurt {

BvhBoxes boxes_of(const BvhNode &node, const BvhFrame &frame)
{
  BvhBoxes boxes;
  for (int k = 0; k < 3; ++k) {
    // The smallest that child 0 can be read as.
    const double half[2] = {float_from_bits(node.half[k] & 0xffff0000u), half1(node.half[k])};
    const double middle[2] = {double(at(node.center0, k)) + at(frame.center, k),
                              double(at(node.center1, k)) + at(frame.center, k)};
    for (int c = 0; c < 2; ++c) {
      boxes.lo[c][k] = middle[c] - half[c];
      boxes.hi[c][k] = middle[c] + half[c];
    }
  }
  return boxes;
}

}  // namespace gpurt
