// Member functions of Caster that make points from echoes.

#include <algorithm>

#include "infrasim/pipeline/caster.h"

namespace infrasim {

/// Merges the echoes of each beam's sub-rays.
void Caster::merge_beams(const Part& part) {
  const ScannerUnit& scanner = part.scanner;
  const bool several = scanner.returns.echo_mode() != EchoMode::kStrongest;
  others_.clear();
  sunlit_ = echoes_.reflectance;
  EchoMerger(scanner.returns.separation_m(), scanner.returns.path())
      .merge(sub_, sub_echoes_, weaker_, beams_, rays_.ring, echoes_, sunlit_,
             several ? &others_ : nullptr);
}

/// Appends the weaker echoes of the rays to `echoes_`. Each echo gets the number, the ring and the
/// sunlit reflectance of its ray.
void Caster::add_other_echoes() {
  std::ranges::stable_sort(others_, {}, &WeakerEcho::ray);
  const std::size_t n = rays_.size();
  number_ = rays_.number;
  ring_ = rays_.ring;
  rank_.assign(n, 0);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < others_.size(); ++i) {
    const bool same = kept > 0 && others_[kept - 1].ray == others_[i].ray;
    const auto rank = static_cast<std::uint8_t>(same ? rank_.back() + 1 : 1);
    if (rank >= kMostEchoes) continue;
    others_[kept++] = others_[i];
    rank_.push_back(rank);
    number_.push_back(rays_.number[others_[i].ray]);
    ring_.push_back(rays_.ring[others_[i].ray]);
    sunlit_.push_back(sunlit_[others_[i].ray]);
  }
  others_.resize(kept);
  echoes_.resize(n + kept);
  for (std::size_t i = 0; i < kept; ++i) echoes_.set(n + i, others_[i].echo);
}

/// Keeps only the returns that the echo mode selects, in the order of their rays.
void Caster::choose_echoes(EchoMode mode) {
  if (others_.empty()) return;
  const auto first_other =
      std::ranges::lower_bound(returns_.echo, static_cast<std::uint32_t>(rays_.size()));
  auto other = first_other - returns_.echo.begin();
  const ReturnBatch all = returns_;
  std::vector<std::size_t> kept, rows;  // indices of returns in `all`
  const auto range = [&](std::size_t row) { return echoes_.range[all.echo[row]]; };
  const auto choose = [&] {
    if (rows.size() < 2) return kept.insert(kept.end(), rows.begin(), rows.end()), void();
    // The first entry of `rows` is the strongest return of the ray.
    const std::size_t nearest = *std::ranges::min_element(rows, {}, range);
    const std::size_t farthest = *std::ranges::max_element(rows, {}, range);
    if (mode == EchoMode::kFirst) return kept.push_back(nearest);
    if (mode == EchoMode::kLast) return kept.push_back(farthest);
    kept.push_back(rows[0]);
    kept.push_back(farthest == rows[0] ? rows[1] : farthest);
  };
  const auto mains = static_cast<std::size_t>(other);
  std::size_t main = 0, more = mains;
  while (main < mains || more < all.size()) {
    const std::uint32_t a = main < mains ? all.echo[main] : ~0U;
    const std::uint32_t b = more < all.size() ? ray_of(all.echo[more]) : ~0U;
    rows.clear();
    if (a <= b) rows.push_back(main++);
    for (const std::uint32_t ray = std::min(a, b);
         more < all.size() && ray_of(all.echo[more]) == ray;)
      rows.push_back(more++);
    choose();
  }
  returns_.resize(kept.size());
  for (std::size_t n = 0; n < kept.size(); ++n) {
    returns_.echo[n] = all.echo[kept[n]];
    returns_.range[n] = all.range[kept[n]];
    returns_.intensity[n] = all.intensity[kept[n]];
  }
}

void Caster::detect(const Part& part, FrameBuilder& out) {
  const bool wide = part.scanner.beam.has_value();
  const EchoMode mode = part.scanner.returns.echo_mode();
  if (mode == EchoMode::kStrongest) others_.clear();
  const bool several = mode != EchoMode::kStrongest && !others_.empty();
  if (several) add_other_echoes();
  StageTimes::measure(times_, Stage::kReturns, [&] {
    part.scanner.returns.apply(
        part.frame, part.first_ray, echoes_, wide ? sunlit_ : echoes_.reflectance,
        several ? ring_ : rays_.ring, returns_, several ? number_ : rays_.number,
        several ? std::span<const std::uint8_t>(rank_) : std::span<const std::uint8_t>{});
    choose_echoes(mode);
  });
  StageTimes::measure(times_, Stage::kMaking, [&] { make_returned_rays(part); });
  StageTimes::measure(times_, Stage::kCollecting,
                      [&] { collect(part.vehicles.moving, wide, out); });
}

void Caster::collect(std::span<const MovingObject> objects, bool wide, FrameBuilder& out) const {
  out.reserve(returns_.size());
  std::uint32_t before = ~0U;  // ray of the previous return
  for (std::size_t n = 0; n < returns_.size(); ++n) {
    const std::uint32_t echo = returns_.echo[n], i = ray_of(echo);
    const std::int32_t object = echoes_.object[echo];
    if (bodies_only_ && object < 0) continue;
    const MovingObject* hit = object < 0 ? nullptr : &objects[static_cast<std::size_t>(object)];
    out.add({.dx = rays_.dx[i],
             .dy = rays_.dy[i],
             .dz = rays_.dz[i],
             .range = returns_.range[n],
             .hit_range = echoes_.range[echo],
             .wide = wide,
             .second = i == before,
             .intensity = returns_.intensity[n],
             .time = rays_.time[i],
             .ring = rays_.ring[i],
             .class_id = hit != nullptr ? static_cast<std::uint16_t>(hit->object_class)
                                        : echoes_.class_id[echo],
             .object = object},
            hit != nullptr ? hit->id : -1);
    before = i;
  }
}

}  // namespace infrasim
