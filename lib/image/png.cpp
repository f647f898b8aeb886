#include "image/png.h"

#include <png.h>

#include <cmath>
#include <vector>

#include "error.h"
#include "image/atomic_file.h"

namespace gpurt {

float tonemap(float radiance)
{
  if (!(radiance > 0)) return 0;
  const float x = std::isinf(radiance) ? 1.0f : radiance / (1 + radiance);
  return x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f;
}

namespace {

// libpng is C: no exception may pass through it. Its callbacks keep the first one here and leave by longjmp.
struct PngState {
  AtomicFile &file;
  std::exception_ptr error;
};

void png_write(png_structp png, png_bytep data, size_t size)
{
  auto &state = *static_cast<PngState *>(png_get_io_ptr(png));
  bool failed = false;
  try {
    state.file.write(data, size);
  } catch (...) {
    state.error = std::current_exception();
    failed = true;
  }
  if (failed) png_error(png, "write");
}

void png_flush(png_structp) {}

void png_failed(png_structp png, png_const_charp text)
{
  auto &state = *static_cast<PngState *>(png_get_error_ptr(png));
  if (!state.error) {
    state.error = std::make_exception_ptr(
        Error(GPURT_ERROR_IO, fmt::format("{}: cannot be written as PNG: {}", state.file.path(), text)));
  }
  png_longjmp(png, 1);
}

void png_warned(png_structp, png_const_charp) {}

// Nothing in this frame has a destructor, so that longjmp may leave it. False: failed.
bool write_header(png_structp png, png_infop info, PngState *state, uint32_t width, uint32_t height)
{
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_write_fn(png, state, png_write, png_flush);
  png_set_IHDR(png, info, width, height, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_RELATIVE);
  png_write_info(png, info);
  return true;
}

bool write_row(png_structp png, const uint8_t *row)
{
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_row(png, row);
  return true;
}

bool write_end(png_structp png, png_infop info)
{
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_end(png, info);
  return true;
}

// Owns the two structures of libpng.
struct PngWriter {
  PngState state;
  png_structp png;
  png_infop info;

  explicit PngWriter(AtomicFile &file)
      : state{file, nullptr},
        png(png_create_write_struct(PNG_LIBPNG_VER_STRING, &state, png_failed, png_warned)),
        info(png ? png_create_info_struct(png) : nullptr)
  {
    if (!info) {
      png_destroy_write_struct(&png, nullptr);
      fail(GPURT_ERROR_OUT_OF_MEMORY, "{}: no memory for the PNG encoder", file.path());
    }
  }
  ~PngWriter() { png_destroy_write_struct(&png, &info); }
  void check(bool ok) const
  {
    if (!ok) std::rethrow_exception(state.error);
  }
};

}  // namespace

void write_png(const std::string &path, uint32_t width, uint32_t height, const PngFill &fill)
{
  AtomicFile file(path);
  {
    PngWriter writer(file);
    writer.check(write_header(writer.png, writer.info, &writer.state, width, height));
    std::vector<float> linear(size_t(width) * 3);
    std::vector<uint8_t> row(size_t(width) * 3);
    for (uint32_t y = 0; y < height; ++y) {
      fill(y, linear.data());
      for (size_t i = 0; i < row.size(); ++i) row[i] = uint8_t(std::lround(tonemap(linear[i]) * 255));
      writer.check(write_row(writer.png, row.data()));
    }
    writer.check(write_end(writer.png, writer.info));
  }
  file.commit();
}

}  // namespace gpurt
