// -o and --exposure: pictures of a frame.
#include <cmath>

#include "options.h"
#include "report.h"
#include "scenes/texture.h"

namespace cli {

namespace {

// As the library writes PNG files, of radiance times 2^exposure.
void save_exposed_png(gpurt_frame frame, const std::string &path, double exposure)
{
  const gpurt_statistics s = statistics_of(frame);
  std::vector<float> color(size_t(s.width) * s.height * 3);
  check(gpurt_frame_read(frame, GPURT_OUTPUT_COLOR, color.data(), color.size() * sizeof(float)));
  const double scale = std::exp2(exposure);
  const auto tonemap = [&](float radiance) {
    const double x = radiance > 0 ? radiance * scale : 0;
    return std::isinf(x) ? 1 : x / (1 + x);
  };
  size_t next = 0;
  // Asked for row by row, from the top left.
  const std::vector<uint8_t> png = scenes::make_png(int(s.width), int(s.height), false, [&](double, double) {
    const float *c = &color[next];
    next += 3;
    return scenes::Texel{{tonemap(c[0]), tonemap(c[1]), tonemap(c[2])}};
  });
  write_file(path, std::string(png.begin(), png.end()));
}

}  // namespace

void OutputOptions::add_to(CLI::App &command)
{
  command.add_option("-o,--output", paths, "file to write, .exr, .png or .gpurt; may be given several times")
      ->allow_extra_args(false)
      ->type_name("FILE");
  command.add_option("--exposure", exposure, "of .png files, in stops: 1 doubles the radiance, -1 halves it")
      ->check(CLI::Range(-100.0, 100.0))
      ->type_name("STOPS")
      ->capture_default_str();
}

void OutputOptions::check_paths() const
{
  if (!std::isfinite(exposure)) fail_usage("--exposure {}: write a number of stops", exposure);
  for (const std::string &path : paths) {
    const std::string extension = extension_of(path);
    if (extension != ".exr" && extension != ".png" && extension != ".gpurt") {
      fail_usage("-o {}: its extension is none of .exr, .png and .gpurt", path);
    }
    check_folder_of(path);
  }
}

void OutputOptions::save(gpurt_frame frame) const
{
  for (const std::string &path : paths) {
    if (exposure != 0 && extension_of(path) == ".png") save_exposed_png(frame, path, exposure);
    else check(gpurt_frame_save(frame, path.c_str()));
  }
}

}  // namespace cli
