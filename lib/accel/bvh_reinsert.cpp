#include "accel/bvh_reinsert.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "accel/bvh_split.h"

namespace gpurt {
namespace {

// A tenth of all places, those with the largest boxes, brings nine tenths of what all of them would, and two passes what
// three would. With more than `most_candidates` the search would take longer than the splits.
constexpr uint64_t share_of_candidates = 10, always_candidates = 1024, most_candidates = 65536;
constexpr int num_passes = 2;
// What a place may add at most of what taking out has saved. Small gains in area are none in steps: with all of them camera
// rays into 8.3 million triangles take 2 % more steps, with these 1 %, and what is badly placed gains far more.
constexpr double worthwhile = 0.8;

constexpr uint32_t no_place = 0xffffffffu;

// A place is one child of a node: 2 * node + side.
class Reinserter {
 public:
  Reinserter(BvhBuildNode *nodes, uint64_t count, uint32_t root)
      : nodes_(nodes), count_(count), root_(root), hangs_at_(count, no_place), height_(count)
  {
    for (uint64_t i = 0; i < count; ++i) {
      for (int s = 0; s < 2; ++s) {
        const uint32_t child = nodes[i].child[s];
        if (!is_bvh_leaf(child)) hangs_at_[child] = uint32_t(2 * i + s);
      }
    }
    for (uint64_t i = count; i-- > 0;) height_[i] = height_of(uint32_t(i));
  }

  void run()
  {
    for (int pass = 0; pass < num_passes; ++pass) {
      uint64_t num_moved = 0;
      for (const uint32_t place : candidates()) num_moved += move(place);
      if (num_moved == 0) return;
    }
  }

 private:
  Box &box(uint32_t place) { return nodes_[place / 2].box[place % 2]; }
  uint32_t &child(uint32_t place) { return nodes_[place / 2].child[place % 2]; }

  uint8_t height_below(uint32_t word) const { return is_bvh_leaf(word) ? 0 : height_[word]; }
  uint8_t height_of(uint32_t node) const
  {
    return uint8_t(1 + std::max(height_below(nodes_[node].child[0]), height_below(nodes_[node].child[1])));
  }

  // The places with the largest boxes, the largest first, of equal ones the lowest.
  std::vector<uint32_t> candidates()
  {
    const uint64_t num_places = 2 * count_;
    const uint64_t wanted = std::clamp(num_places / share_of_candidates,
                                       std::min(num_places, always_candidates), most_candidates);
    std::vector<std::pair<double, uint32_t>> kept;  // a heap, the smallest on top
    kept.reserve(wanted + 1);
    const auto is_larger = [](const auto &a, const auto &b) {
      return a.first != b.first ? a.first > b.first : a.second < b.second;
    };
    for (uint32_t place = 0; place < num_places; ++place) {
      const std::pair next = {half_area(box(place)), place};
      if (kept.size() == wanted && !is_larger(next, kept.front())) continue;
      kept.push_back(next);
      std::push_heap(kept.begin(), kept.end(), is_larger);
      if (kept.size() <= wanted) continue;
      std::pop_heap(kept.begin(), kept.end(), is_larger);
      kept.pop_back();
    }
    std::sort(kept.begin(), kept.end(), is_larger);
    std::vector<uint32_t> places;
    for (const auto &k : kept) places.push_back(k.second);
    return places;
  }

  void put(uint32_t place, uint32_t word, const Box &bounds)
  {
    child(place) = word;
    box(place) = bounds;
    if (!is_bvh_leaf(word)) hangs_at_[word] = place;
  }

  // Boxes and heights from `node` up to the root; the sum of the areas of their nodes, the root's left out.
  double update_from(uint32_t node)
  {
    double area = 0;
    for (;;) {
      height_[node] = height_of(node);
      if (node == root_) return area;
      const uint32_t place = hangs_at_[node];
      box(place) = extend(nodes_[node].box[0], nodes_[node].box[1]);
      area += half_area(box(place));
      node = place / 2;
    }
  }

  double area_up_from(uint32_t node)
  {
    double area = 0;
    for (; node != root_; node = hangs_at_[node] / 2) area += half_area(box(hangs_at_[node]));
    return area;
  }

  // Takes out what hangs at `place`, with the node above it, and puts both back where they add least. Whether that is
  // elsewhere.
  bool move(uint32_t place)
  {
    const uint32_t node = place / 2;
    if (node == root_) return false;
    const uint32_t above = hangs_at_[node];
    const double before = area_up_from(node);
    const Box bounds = box(place), sibling_bounds = box(place ^ 1);
    const uint32_t word = child(place), sibling = child(place ^ 1);
    put(above, sibling, sibling_bounds);
    const double saved = before - update_from(above / 2);

    const uint32_t best = find_place(bounds, height_below(word), saved);
    // Back, or between what hangs at the best place and what that hangs from. The sibling is again at its own place then.
    const uint32_t at = best == no_place ? above : best;
    put(place ^ 1, child(at), box(at));
    put(at, node, bounds);
    update_from(node);
    return best != no_place;
  }

  struct Step {
    double added;  // by the nodes above, if the search goes on below this place
    uint32_t place;
    uint32_t depth;
    bool operator<(const Step &other) const  // the cheapest first, of equal ones the lowest
    {
      return added != other.added ? added > other.added : place > other.place;
    }
  };

  // Where a subtree adds least to the areas of nodes, if that is less than `limit`. Branch and bound: what is added above a
  // place only grows on the way down, and at least the subtree's own area is added at the place.
  uint32_t find_place(const Box &bounds, uint32_t height, double limit)
  {
    const double own = half_area(bounds);
    uint32_t best = no_place;
    limit *= worthwhile;
    todo_.clear();
    const auto visit = [&](uint32_t node, double added, uint32_t depth) {
      for (uint32_t s = 0; s < 2; ++s) todo_.push_back({added, 2 * node + s, depth});
      std::push_heap(todo_.begin(), todo_.end() - 1);
      std::push_heap(todo_.begin(), todo_.end());
    };
    visit(root_, 0, 1);
    while (!todo_.empty()) {
      std::pop_heap(todo_.begin(), todo_.end());
      const Step step = todo_.back();
      todo_.pop_back();
      if (step.added + own >= limit) break;
      const uint32_t word = child(step.place);
      const double together = half_area(extend(box(step.place), bounds));
      const double cost = step.added + together;
      if (cost < limit &&
          step.depth + 1 + std::max<uint32_t>(height, height_below(word)) <= uint32_t(bvh_max_depth)) {
        limit = cost;
        best = step.place;
      }
      const double below = cost - half_area(box(step.place));
      if (!is_bvh_leaf(word) && below + own < limit) visit(word, below, step.depth + 1);
    }
    return best;
  }

  BvhBuildNode *nodes_;
  const uint64_t count_;
  const uint32_t root_;
  std::vector<uint32_t> hangs_at_;  // the place at which a node hangs
  std::vector<uint8_t> height_;     // inner nodes on the longest way from a node to a leaf, its own included
  std::vector<Step> todo_;
};

}  // namespace

void reinsert(BvhBuildNode *nodes, uint64_t count, uint32_t root)
{
  if (count > 1) Reinserter(nodes, count, root).run();
}

}  // namespace gpurt
