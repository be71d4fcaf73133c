#include "infrasim/config/scene_keys.h"

#include "infrasim/config/filter_declarations.h"

namespace infrasim {

/// Visits the keys of a box filter. In a scene file, each side of the box has its own key.
template <class Fields>
void visit(Fields& f, CropBox& c) {
  static constexpr std::array kMin{"x_min_m", "y_min_m", "z_min_m"};
  static constexpr std::array kMax{"x_max_m", "y_max_m", "z_max_m"};
  const auto [min, max] = config::declaration(config::Of<CropBox>{}).parameters;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    f.field(kMin[axis], c.min_m[axis], min.doc, min.rule);
    f.field(kMax[axis], c.max_m[axis], max.doc, max.rule);
    f.check(c.max_m[axis] > c.min_m[axis], kMax[axis],
            "expected more than the minimum of this axis, got the minimum or less");
  }
}

template <class Fields>
void check(Fields& f, const CropPolygon& c) {
  f.check(c.outline_m.size() >= 3, "outline_m", "expected 3 or more corners, got fewer");
  f.check(signed_area(c.outline_m) != 0, "outline_m", "expected an outline with an area, got none");
}

template <class Fields>
void check(Fields& f, const CropRange& c) {
  f.check(c.max_m > c.min_m, "max_m", "expected above min_m, got min_m or less");
}

template <class Fields>
void check(Fields& f, const CropFieldOfView& c) {
  f.check(c.elevation_max_deg > c.elevation_min_deg, "elevation_max_deg",
          "expected above elevation_min_deg, got elevation_min_deg or less");
}

template <class Fields>
void check(Fields& f, const GroundMorphological& c) {
  f.check(c.window_m >= c.cell_m, "window_m", "expected cell_m or more, got less");
  f.check(c.max_range_m <= 2000 * c.cell_m, "max_range_m",
          "expected at most 2000 cells of cell_m, got more");
}

template <class Fields, class Filter>
  requires requires { config::declaration(config::Of<Filter>{}); }
void visit(Fields& f, Filter& c) {
  std::apply([&](const auto&... p) { (f.field(p.name, c.*p.member, p.doc, p.rule), ...); },
             config::declaration(config::Of<Filter>{}).parameters);
  if constexpr (requires { check(f, c); }) check(f, c);
}

template <class Fields>
void visit(Fields& f, FilterConfig& c) {
  int steps = 0;
  f.here(c.place);
  config::for_each_filter(config::Of<decltype(c.step)>{},
                          [&]<class Filter>(config::Of<Filter> filter) {
                            std::optional<Filter> step;
                            if constexpr (std::is_same_v<Fields, config::FieldWriter>)
                              if (const auto* set = std::get_if<Filter>(&c.step)) step = *set;
                            const auto declared = config::declaration(filter);
                            f.field(declared.key, step, declared.doc);
                            if (!step) return;
                            c.step = *step;
                            ++steps;
                          });
  f.check(steps == 1, "crop_box",
          "expected one filter in each entry of filters, got none or several");
}

template void visit(config::FieldReader&, FilterConfig&);
template void visit(config::FieldWriter&, FilterConfig&);
template void visit(config::FieldLister&, FilterConfig&);

}  // namespace infrasim
