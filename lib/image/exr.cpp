#include "image/exr.h"

#include <Iex.h>
#include <ImfChannelList.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfIntAttribute.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <new>

#include "error.h"
#include "image/atomic_file.h"

namespace gpurt {

namespace {

class ExrStream : public Imf::OStream {
 public:
  explicit ExrStream(AtomicFile &file) : OStream(file.path().c_str()), file_(file) {}
  void write(const char bytes[], int count) override { file_.write(bytes, uint64_t(count)); }
  uint64_t tellp() override { return file_.tell(); }
  void seekp(uint64_t position) override { file_.seek(position); }

 private:
  AtomicFile &file_;
};

// OpenEXR's texts may have several lines; ours have one.
std::string one_line(std::string text)
{
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

uint64_t file_size(const std::string &path)
{
  struct stat status;
  if (::stat(path.c_str(), &status) != 0)
    fail(GPURT_ERROR_IO, "{}: cannot be read: {}", path, std::strerror(errno));
  if (S_ISDIR(status.st_mode)) fail(GPURT_ERROR_IO, "{}: is a folder, not an EXR file", path);
  return uint64_t(status.st_size);
}

std::string channel_names(const Imf::ChannelList &channels)
{
  std::string names;
  for (auto channel = channels.begin(); channel != channels.end(); ++channel) {
    names += fmt::format("{}{}", names.empty() ? "" : ", ", channel.name());
  }
  return names.empty() ? "none" : names;
}

ImageRgba read_rgba(const std::string &path, uint64_t size_bytes)
{
  Imf::InputFile file(path.c_str());
  const Imath::Box2i window = file.header().dataWindow();
  const int64_t width = int64_t(window.max.x) - window.min.x + 1,
                height = int64_t(window.max.y) - window.min.y + 1;
  // No compression of the format shrinks a pixel to fewer than 1/4096 bytes, so a damaged size costs no memory.
  if (width <= 0 || height <= 0 || uint64_t(width) * uint64_t(height) / 4096 > size_bytes) {
    fail(GPURT_ERROR_IO, "{}: damaged: {} bytes cannot hold {} x {} pixels", path, size_bytes, width, height);
  }
  const Imf::ChannelList &channels = file.header().channels();
  const bool has_rgb = channels.findChannel("R") && channels.findChannel("G") && channels.findChannel("B");
  if (!has_rgb && !channels.findChannel("Y")) {
    fail(GPURT_ERROR_IO, "{}: has no channels R, G and B, nor Y; it has {}", path, channel_names(channels));
  }

  ImageRgba image{uint32_t(width), uint32_t(height), {}};
  image.pixels.resize(uint64_t(width) * uint64_t(height) * 4);
  const size_t x_stride = 4 * sizeof(float), y_stride = x_stride * size_t(width);
  // OpenEXR addresses pixels by their place in the data window, which need not start at the origin.
  char *origin = reinterpret_cast<char *>(image.pixels.data()) - ptrdiff_t(x_stride) * window.min.x -
                 ptrdiff_t(y_stride) * window.min.y;
  const char *names[4] = {has_rgb ? "R" : "Y", "G", "B", "A"};
  Imf::FrameBuffer buffer;
  for (int c = 0; c < 4; ++c) {
    if (!has_rgb && (c == 1 || c == 2)) continue;
    buffer.insert(names[c], Imf::Slice(Imf::FLOAT, origin + c * sizeof(float), x_stride, y_stride, 1, 1,
                                       c == 3 ? 1.0 : 0.0));
  }
  file.setFrameBuffer(buffer);
  file.readPixels(window.min.y, window.max.y);
  if (!has_rgb) {
    for (size_t i = 0; i < image.pixels.size(); i += 4)
      image.pixels[i + 1] = image.pixels[i + 2] = image.pixels[i];
  }
  return image;
}

}  // namespace

ImageRgba read_exr_rgba(const std::string &path)
{
  const uint64_t size_bytes = file_size(path);
  try {
    return read_rgba(path, size_bytes);
  } catch (const Error &) {
    throw;
  } catch (const std::bad_alloc &) {
    fail(GPURT_ERROR_OUT_OF_MEMORY, "{}: no memory for its pixels", path);
  } catch (const std::exception &error) {
    fail(GPURT_ERROR_IO, "{}: not a readable EXR file: {}", path, one_line(error.what()));
  }
}

void write_exr(const std::string &path, uint32_t width, uint32_t height,
               const std::vector<ExrChannel> &channels, const ExrAttributes &attributes, const ExrFill &fill)
{
  AtomicFile file(path);
  try {
    Imf::Header header(static_cast<int>(width), static_cast<int>(height));
    header.compression() = Imf::ZIP_COMPRESSION;
    for (const ExrChannel &channel : channels) {
      header.channels().insert(channel.name,
                               Imf::Channel(channel.type == ExrType::Float ? Imf::FLOAT : Imf::UINT));
    }
    for (const auto &[name, value] : attributes) {
      if (const auto *text = std::get_if<std::string>(&value))
        header.insert(name, Imf::StringAttribute(*text));
      else if (const auto *whole = std::get_if<int>(&value)) header.insert(name, Imf::IntAttribute(*whole));
      else header.insert(name, Imf::FloatAttribute(std::get<float>(value)));
    }
    ExrStream stream(file);
    Imf::OutputFile output(stream, header);

    constexpr uint32_t rows_per_block = 64;  // a multiple of the 16 rows that ZIP packs together
    const size_t plane_size = size_t(width) * std::min(rows_per_block, height);
    std::vector<std::vector<uint32_t>> storage(channels.size(), std::vector<uint32_t>(plane_size));
    std::vector<void *> planes;
    for (auto &plane : storage) planes.push_back(plane.data());
    for (uint32_t y0 = 0; y0 < height; y0 += rows_per_block) {
      const uint32_t y1 = std::min(height - y0, rows_per_block) + y0;
      fill(y0, y1, planes);
      Imf::FrameBuffer buffer;
      for (size_t c = 0; c < channels.size(); ++c) {
        const size_t y_stride = size_t(width) * 4;
        buffer.insert(channels[c].name,
                      Imf::Slice(channels[c].type == ExrType::Float ? Imf::FLOAT : Imf::UINT,
                                 static_cast<char *>(planes[c]) - ptrdiff_t(y_stride) * y0, 4, y_stride));
      }
      output.setFrameBuffer(buffer);
      output.writePixels(int(y1 - y0));
    }
  } catch (const Error &) {
    throw;
  } catch (const std::bad_alloc &) {
    throw;
  } catch (const std::exception &error) {
    fail(GPURT_ERROR_IO, "{}: cannot be written as EXR: {}", path, one_line(error.what()));
  }
  file.commit();
}

}  // namespace gpurt
