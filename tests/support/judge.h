// Judges the hits of a watertight method by what exact geometry leaves it free to say.
#pragma once

#include <cstdio>

#include "exact_oracle.h"

namespace gpurt_test {

enum class Outcome {
  ExactHit,   // every edge is cleared up to the hit: the primitive is that of exact intersection
  ExactMiss,  // nothing could be hit, nothing was
  Tie,        // cleared, but two surfaces lie closer than their t is known: the other one
  Near,  // an edge, or an end of [tmin, tmax], within the bound: one of the triangles there, t within its bound
  Leak,   // failure: passed through a surface
  Wrong,  // failure: a triangle that is not met, t out of its bound, order or number of hits
  Count
};
inline const char *const outcome_names[] = {"exact hit", "exact miss", "tie", "near", "LEAK", "WRONG"};

inline Outcome judge_closest(const RayTruth &truth, const gpurt_ray &ray, const gpurt_hit &hit)
{
  // No farther than this: something there is hit, however the test rounds.
  float farthest = infinite;
  bool must_hit = false;
  const auto demand = [&](float t_low, float t_high) {
    if (t_low < ray.tmin || t_high > ray.tmax) return;
    must_hit = true;
    farthest = std::min(farthest, t_high);
  };
  for (const Candidate &c : truth.candidates) {
    if (!c.is_near) demand(c.t_low, c.t_high);
  }
  for (const Cluster &c : truth.clusters) {
    if (c.winding != 0) demand(c.t_low, c.t_high);
  }
  const auto is_optional = [&](const Candidate &c) {
    return c.t_high >= ray.tmin && c.t_low <= std::min(ray.tmax, farthest) &&
           (c.is_near || c.t_low < ray.tmin || c.t_high > ray.tmax);
  };
  const bool is_cleared = std::none_of(truth.candidates.begin(), truth.candidates.end(), is_optional);

  if (hit.primitive == GPURT_INVALID_ID) {
    if (must_hit) return Outcome::Leak;
    return is_cleared ? Outcome::ExactMiss : Outcome::Near;
  }
  const Candidate *c = truth.find(hit.primitive);
  if (c == nullptr || !(hit.t >= c->t_low && hit.t <= c->t_high)) return Outcome::Wrong;
  if (!(hit.t >= ray.tmin && hit.t <= ray.tmax)) return Outcome::Wrong;
  if (hit.t > farthest) return Outcome::Leak;
  if (!is_cleared) return Outcome::Near;
  return hit.primitive == truth.nearest ? Outcome::ExactHit : Outcome::Tie;
}

/// All crossings of the half-open rule: each clear triangle once, of each cluster as many as its winding is odd or even.
inline Outcome judge_all(const RayTruth &truth, const gpurt_ray &ray, const gpurt_hit *first,
                         const gpurt_hit *last)
{
  std::vector<int> of_cluster(truth.clusters.size(), 0);
  std::set<uint32_t> seen;
  bool is_near = false;
  for (const gpurt_hit *h = first; h != last; ++h) {
    if (h != first && !(h[-1].t < h->t || (h[-1].t == h->t && h[-1].primitive < h->primitive)))
      return Outcome::Wrong;
    const Candidate *c = truth.find(h->primitive);
    if (c == nullptr || !(h->t >= c->t_low && h->t <= c->t_high)) return Outcome::Wrong;
    if (!(h->t >= ray.tmin && h->t <= ray.tmax) || !seen.insert(h->primitive).second) return Outcome::Wrong;
    if (c->is_near) ++of_cluster[c->cluster];
  }
  for (const Candidate &c : truth.candidates) {
    if (c.is_near || c.t_high < ray.tmin || c.t_low > ray.tmax) continue;
    if (c.t_low < ray.tmin || c.t_high > ray.tmax) is_near = true;
    else if (!seen.count(c.triangle)) return Outcome::Leak;
  }
  for (size_t i = 0; i < truth.clusters.size(); ++i) {
    const Cluster &c = truth.clusters[i];
    if (c.t_high < ray.tmin || c.t_low > ray.tmax) continue;
    is_near = true;
    if (c.is_open || c.t_low < ray.tmin || c.t_high > ray.tmax) continue;
    if (((of_cluster[i] - c.winding) & 1) != 0 || (c.winding != 0 && of_cluster[i] == 0))
      return Outcome::Leak;
  }
  if (is_near) return Outcome::Near;
  return first == last ? Outcome::ExactMiss : Outcome::ExactHit;
}

/// Counts outcomes and shows the first failures, their rays in hexadecimal so that they can be repeated.
class Tally {
 public:
  explicit Tally(std::string title) : title_(std::move(title)) {}

  void add(Outcome outcome, const gpurt_ray &ray, const char *kind, uint32_t primitive, float t,
           const RayTruth &truth)
  {
    ++count_[int(outcome)];
    if (outcome != Outcome::Leak && outcome != Outcome::Wrong) return;
    if (count_[int(Outcome::Leak)] + count_[int(Outcome::Wrong)] > 5) return;
    std::printf(
        "%s: %s, %s ray: origin %a %a %a, direction %a %a %a, t in [%a, %a]; got triangle %d at t %a\n",
        title_.c_str(), outcome_names[int(outcome)], kind, ray.origin[0], ray.origin[1], ray.origin[2],
        ray.direction[0], ray.direction[1], ray.direction[2], ray.tmin, ray.tmax, int(primitive), t);
    for (const Candidate &c : truth.candidates) {
      std::printf("    triangle %u: %s%s, t in [%.9g, %.9g]", c.triangle, c.is_near ? "near" : "clear",
                  c.is_met ? ", met" : "", c.t_low, c.t_high);
      if (c.is_near) {
        const Cluster &k = truth.clusters[c.cluster];
        std::printf(", cluster %u%s, winding %d", c.cluster, k.is_open ? " (open)" : "", k.winding);
      }
      std::printf("\n");
    }
  }

  uint64_t operator[](Outcome o) const { return count_[int(o)]; }
  uint64_t failures() const { return count_[int(Outcome::Leak)] + count_[int(Outcome::Wrong)]; }

  void print() const
  {
    uint64_t total = 0;
    for (uint64_t c : count_) total += c;
    std::printf("%s: %llu rays:", title_.c_str(), static_cast<unsigned long long>(total));
    for (int i = 0; i < int(Outcome::Count); ++i) {
      std::printf(" %s %.4f%%", outcome_names[i],
                  100.0 * double(count_[i]) / double(std::max<uint64_t>(total, 1)));
    }
    std::printf("\n");
  }

 private:
  std::string title_;
  uint64_t count_[int(Outcome::Count)] = {};
};

}  // namespace gpurt_test
