// Member functions of Caster that cast wide beams as several sub-rays.

#include <algorithm>
#include <numeric>

#include "infrasim/pipeline/caster.h"

namespace infrasim {

std::size_t Caster::cast_beams(const Part& part) {
  const Beam& beam = *part.scanner.beam;
  std::size_t cast = 0;
  if (!part.scanner.layer) {
    if (beam.everywhere()) beams_.swap(selected_), selected_.clear();
    raycaster_.cast_background(rays_, selected_, hits_, true);
    cast += selected_.size();
  }
  if (!beam.everywhere())
    raycaster_.near_bodies(rays_, selected_, hits_.range, beam.half_width(), beam.from_m(), beams_);
  static_range_m_.clear();
  static_gain_.clear();
  static_class_.clear();
  for (const std::uint32_t i : beams_) {
    static_range_m_.push_back(hits_.range[i]);
    static_gain_.push_back(hits_.cos_incidence[i]);
    static_class_.push_back(hits_.class_id[i]);
  }
  sub_rays_.resize(0);
  std::vector<std::uint32_t> every(beams_.size());
  std::iota(every.begin(), every.end(), 0U);
  if (beam.everywhere()) {
    cast_sub_rays(part, every, 0, beam.sub_rays());
    return cast + sub_rays_.size();
  }
  // Rays without sub-rays are cast as single rays, because they can meet bodies near the sensor.
  auto next = beams_.begin();
  std::erase_if(selected_, [&](std::uint32_t ray) {
    const bool beam_of_ray = next != beams_.end() && *next == ray;
    if (beam_of_ray) ++next;
    return beam_of_ray;
  });
  raycaster_.cast_bodies(rays_, selected_, hits_, true);
  cast_sub_rays(part, every, 0, beam.probes());
  cast += sub_rays_.size() + selected_.size();
  keep_beams_on_bodies(part);
  const std::size_t probes = sub_rays_.size();
  if (beam.probes() < beam.sub_rays())
    cast_sub_rays(part, mixed_beams(part), beam.probes(), beam.sub_rays());
  return cast + sub_rays_.size() - probes;
}

/// Appends the sub-rays numbered `from` to `to` - 1 of the given beams to `sub_rays_`, and finds
/// the hits of these sub-rays.
/// @param beams indices into `beams_`
void Caster::cast_sub_rays(const Part& part, std::span<const std::uint32_t> beams, std::size_t from,
                           std::size_t to) {
  const Beam& beam = *part.scanner.beam;
  const std::size_t first = sub_rays_.size(), n = to - from;
  std::vector<std::uint32_t> rays;
  for (const std::uint32_t b : beams) rays.push_back(beams_[b]);
  beam.expand(rays_, rays, from, to, sub_rays_);
  sub_.resize(sub_rays_.size());
  sub_number_.resize(sub_rays_.size());
  const std::span<const float> shares =
      from == 0 && to == beam.probes() ? beam.probe_shares() : beam.shares();
  for (std::size_t k = first; k < sub_rays_.size(); ++k) {
    const std::size_t number = from + (k - first) % n;
    sub_[k] = {beams[(k - first) / n], shares[number]};
    sub_number_[k] = static_cast<std::uint8_t>(number);
  }
  if (from > 0)  // in a full beam, the first sub-rays (probes) have smaller shares of the power
    for (const std::uint32_t b : beams)
      for (std::size_t j = 0; j < from; ++j) sub_[from * b + j].share = shares[j];
  sub_order_.resize(sub_rays_.size() - first);
  std::iota(sub_order_.begin(), sub_order_.end(), static_cast<std::uint32_t>(first));
  if (beam.everywhere()) return raycaster_.cast(sub_rays_, sub_order_, sub_hits_, true);
  sub_hits_.resize(sub_rays_.size());
  for (std::size_t k = first; k < sub_rays_.size(); ++k) {
    sub_hits_.range[k] = static_range_m_[sub_[k].beam];
    sub_hits_.cos_incidence[k] = static_gain_[sub_[k].beam];
    sub_hits_.class_id[k] = static_class_[sub_[k].beam];
    sub_hits_.object[k] = -1;
  }
  raycaster_.cast_bodies(sub_rays_, sub_order_, sub_hits_, true);
}

/// Removes the beams whose first sub-rays (probes) meet no moving object. Such a beam keeps the
/// static hit of its middle ray.
void Caster::keep_beams_on_bodies(const Part& part) {
  const std::size_t n = part.scanner.beam->probes();
  std::size_t kept = 0;
  for (std::size_t beam = 0; beam < beams_.size(); ++beam) {
    bool any = false;
    for (std::size_t k = n * beam; k < n * (beam + 1); ++k) any = any || sub_hits_.object[k] >= 0;
    if (!any) continue;
    if (kept < beam) {
      beams_[kept] = beams_[beam];
      static_range_m_[kept] = static_range_m_[beam];
      static_gain_[kept] = static_gain_[beam];
      static_class_[kept] = static_class_[beam];
      sub_rays_.move_rows(n * beam, n * kept, n);
      sub_hits_.move_rows(n * beam, n * kept, n);
    }
    ++kept;
  }
  beams_.resize(kept);
  sub_rays_.resize(n * kept);
  sub_hits_.resize(n * kept);
  sub_.resize(n * kept);
}

/// Returns the indices in `beams_` of beams whose first sub-rays (probes) meet several surfaces.
std::vector<std::uint32_t> Caster::mixed_beams(const Part& part) const {
  const std::size_t n = part.scanner.beam->probes();
  const double separation_m = part.scanner.returns.separation_m();
  std::vector<std::uint32_t> mixed;
  for (std::size_t beam = 0; beam < beams_.size(); ++beam) {
    const std::span objects = std::span(sub_hits_.object).subspan(n * beam, n);
    const auto [low, high] = std::ranges::minmax(std::span(sub_hits_.range).subspan(n * beam, n));
    const bool one = std::ranges::all_of(objects, [&](int o) { return o == objects.front(); });
    if (!one || !(high - low <= separation_m)) mixed.push_back(static_cast<std::uint32_t>(beam));
  }
  return mixed;
}

/// Returns the hits of the sub-rays on static surfaces. Each sub-ray has the static hit of its
/// beam's middle ray.
StaticSlice Caster::static_hits_of_beams() const {
  return {static_range_m_, static_gain_, static_class_, beam_of_};
}

}  // namespace infrasim
