#include <epoxy/gl.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/lens.h"
#include "render/egl/renderers.h"
#include "render/recent_lenses.h"
#include "render/tiles/tile_renderer.h"

namespace volalign {
namespace {

// Window row 0 is image row 0, so no picture is ever flipped; z is reversed and infinite (1 at
// kNear, 0 at infinity). A face has four vertices.
const char* const kVertexShader = R"(#version 450 core
layout(location = 0) in vec3 position;
uniform vec4 projection;  // 2 fx / W, 2 fy / H, 2 (cx + .5) / W - 1, 2 (cy + .5) / H - 1
uniform float near;
flat out uint face_number;
void main() {
  gl_Position = vec4(projection.xy * position.xy + projection.zw * position.z, near, position.z);
  face_number = uint(gl_VertexID / 4 + 1);
}
)";

const char* const kFragmentShader = R"(#version 450 core
flat in uint face_number;
layout(location = 0) out uint number;
void main() { number = face_number; }
)";

GLuint LinkProgram() {
  const GLuint program = glCreateProgram();
  for (const auto& [kind, source] : {std::pair(GL_VERTEX_SHADER, kVertexShader),
                                     std::pair(GL_FRAGMENT_SHADER, kFragmentShader)}) {
    const GLuint shader = glCreateShader(kind);
    glShaderSource(shader, 1, &source, nullptr);
    glCompileShader(shader);
    glAttachShader(program, shader);
    glDeleteShader(shader);
  }
  glLinkProgram(program);
  GLint ok = GL_FALSE;
  glGetProgramiv(program, GL_LINK_STATUS, &ok);
  if (ok != GL_TRUE) {
    char log[1024] = "";
    glGetProgramInfoLog(program, sizeof(log), nullptr, log);
    glDeleteProgram(program);
    throw Error(fmt::format("OpenGL: program does not link on {}: {}",
                            reinterpret_cast<const char*>(glGetString(GL_RENDERER)), log));
  }
  return program;
}

/// Draws the face that each pixel shows. OpenGL draws no lens: a camera with distortion is drawn by
/// tiles, where each pixel has its own ray.
///
/// Depth does not depend on the rasteriser's interpolation. Every face has its plane n . p = h in
/// the sensor frame. The pixel's ray (x, y, 1) meets it at the depth z = 1 / ((n / h) . (x, y, 1)).
/// This is exact to float rounding.
class GlDepthRenderer : public DepthRenderer {
 public:
  explicit GlDepthRenderer(const EglContextOptions& options) : egl_(options) {
    program_ = LinkProgram();
    projection_location_ = glGetUniformLocation(program_, "projection");
    glUseProgram(program_);
    glUniform1f(glGetUniformLocation(program_, "near"), static_cast<float>(kNear));
    glGenVertexArrays(1, &vertex_array_);
    glGenBuffers(1, &vertex_buffer_);
    glGenBuffers(1, &index_buffer_);
    glBindVertexArray(vertex_array_);
    glBindBuffer(GL_ARRAY_BUFFER, vertex_buffer_);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, index_buffer_);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, sizeof(Eigen::Vector3f), nullptr);
    glEnableVertexAttribArray(0);
    glGenFramebuffers(1, &framebuffer_);
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &max_size_);
  }
  ~GlDepthRenderer() override {
    glDeleteFramebuffers(1, &framebuffer_);
    glDeleteTextures(1, &texture_);
    glDeleteRenderbuffers(1, &z_buffer_);
    glDeleteBuffers(1, &vertex_buffer_);
    glDeleteBuffers(1, &index_buffer_);
    glDeleteVertexArrays(1, &vertex_array_);
    glDeleteProgram(program_);
  }
  GlDepthRenderer(const GlDepthRenderer&) = delete;
  GlDepthRenderer& operator=(const GlDepthRenderer&) = delete;

  /// The largest size is that of GL.
  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
              const Pose& structure_from_sensor, RenderedView* view) override {
    if (!intrinsics.distortion.empty())
      return with_lens_->Render(mesh, intrinsics, structure_from_sensor, view);
    RequireDrawable(mesh, intrinsics.width, intrinsics.height, max_size_);
    FitImages(intrinsics, view);
    DrawNumbers(mesh, intrinsics, structure_from_sensor);
    view->rays =
        rays_.Get(intrinsics, [](const Intrinsics& k) { return ViewRays(ComputeRays(k)); });
    for (std::size_t i = 0; i < view->depth.size(); ++i) {
      const FaceInView* const face = numbers_[i] > 0 ? &faces_[numbers_[i] - 1] : nullptr;
      view->depth[i] = face ? DepthOf(*face, view->rays->rays[i].homogeneous()) : 0;
      view->labels[i] = static_cast<std::uint8_t>(face ? face->id >> 16 : 0);
      view->faces[i] = static_cast<std::uint16_t>(face ? face->id : 0);
    }
    const GLenum error = glGetError();
    if (error == GL_CONTEXT_LOST) {
      throw Error(
          "OpenGL: the device was reset, and its context is lost; give the command again, or with "
          "the renderer cpu, which needs no OpenGL");
    }
    if (error != GL_NO_ERROR) {
      throw Error(fmt::format("OpenGL: error {:#x} while drawing {} faces at {}x{}", error,
                              faces_.size(), width_, height_));
    }
  }

 private:
  void Resize(int width, int height) {
    if (width == width_ && height == height_) return;
    glDeleteTextures(1, &texture_);
    glDeleteRenderbuffers(1, &z_buffer_);
    glGenTextures(1, &texture_);
    glBindTexture(GL_TEXTURE_2D, texture_);
    glTexStorage2D(GL_TEXTURE_2D, 1, GL_R32UI, width, height);
    glGenRenderbuffers(1, &z_buffer_);
    glBindRenderbuffer(GL_RENDERBUFFER, z_buffer_);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT32F, width, height);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture_, 0);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, z_buffer_);
    const GLenum status = glCheckFramebufferStatus(GL_FRAMEBUFFER);
    if (status != GL_FRAMEBUFFER_COMPLETE) {
      width_ = height_ = 0;
      throw Error(
          fmt::format("OpenGL: no {}x{} framebuffer of R32UI and 32-bit depth (status {:#x})",
                      width, height, status));
    }
    width_ = width;
    height_ = height;
  }

  /// Depth at which the ray (x, y, 1) meets the plane of the face. Outside of its polygon (OpenGL
  /// snaps corners to 1/256 px), a plane seen edge-on has any depth. So z is limited to the face's
  /// range.
  static float DepthOf(const FaceInView& face, const Eigen::Vector3f& ray) {
    constexpr float kRounding = 1e-5F;  // m, of the corners themselves
    const float least = std::max(face.low_z, static_cast<float>(kNear)) - kRounding,
                most = face.high_z + kRounding, inverse = face.inverse.dot(ray);
    return inverse > 0 ? std::clamp(1 / inverse, least, most) : most;
  }

  /// Fills numbers_ with 1 + the index in faces_ of each pixel; 0 without a face.
  void DrawNumbers(const SceneMesh& mesh, const Intrinsics& pinhole,
                   const Pose& structure_from_sensor) {
    Resize(pinhole.width, pinhole.height);
    // The image's outer rim.
    const std::array<float, 4> bounds = {
        static_cast<float>((-0.5 - pinhole.cx) / pinhole.fx),
        static_cast<float>((pinhole.width - 0.5 - pinhole.cx) / pinhole.fx),
        static_cast<float>((-0.5 - pinhole.cy) / pinhole.fy),
        static_cast<float>((pinhole.height - 0.5 - pinhole.cy) / pinhole.fy)};
    FindFacesInView(mesh, structure_from_sensor, bounds, &faces_);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
    glDrawBuffer(GL_COLOR_ATTACHMENT0);
    glViewport(0, 0, width_, height_);
    glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_GREATER);
    glDisable(GL_CULL_FACE);
    glDisable(GL_BLEND);
    const GLuint none[] = {0, 0, 0, 0};
    const GLfloat far[] = {0};
    glClearBufferuiv(GL_COLOR, 0, none);
    glClearBufferfv(GL_DEPTH, 0, far);
    glUseProgram(program_);
    glUniform4f(projection_location_, static_cast<float>(2 * pinhole.fx / pinhole.width),
                static_cast<float>(2 * pinhole.fy / pinhole.height),
                static_cast<float>(2 * (pinhole.cx + 0.5) / pinhole.width - 1),
                static_cast<float>(2 * (pinhole.cy + 0.5) / pinhole.height - 1));
    DrawFaces();
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    numbers_.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
    glReadBuffer(GL_COLOR_ATTACHMENT0);
    glReadPixels(0, 0, width_, height_, GL_RED_INTEGER, GL_UNSIGNED_INT, numbers_.data());
  }

  void DrawFaces() {
    std::vector<Eigen::Vector3f> vertices;
    for (const FaceInView& face : faces_)
      vertices.insert(vertices.end(), face.corners.begin(), face.corners.end());
    glBindVertexArray(vertex_array_);
    glBindBuffer(GL_ARRAY_BUFFER, vertex_buffer_);
    glBufferData(GL_ARRAY_BUFFER,
                 static_cast<GLsizeiptr>(vertices.size() * sizeof(Eigen::Vector3f)),
                 vertices.data(), GL_STREAM_DRAW);
    const std::size_t num_faces = faces_.size();
    if (num_faces > indexed_faces_) {
      indexed_faces_ = std::max<std::size_t>(2 * num_faces, 1024);
      std::vector<std::uint32_t> indices;
      indices.reserve(6 * indexed_faces_);
      for (std::uint32_t i = 0; i < indexed_faces_; ++i) {
        for (const std::uint32_t k : {0U, 1U, 2U, 0U, 2U, 3U}) indices.push_back(4 * i + k);
      }
      glBufferData(GL_ELEMENT_ARRAY_BUFFER,
                   static_cast<GLsizeiptr>(indices.size() * sizeof(std::uint32_t)), indices.data(),
                   GL_STATIC_DRAW);
    }
    glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(6 * num_faces), GL_UNSIGNED_INT, nullptr);
  }

  const EglContext egl_;
  std::vector<FaceInView> faces_;
  const std::unique_ptr<DepthRenderer> with_lens_ = TileRenderers()();
  RecentLenses<std::shared_ptr<const RayTable>> rays_;
  GLuint program_ = 0, vertex_array_ = 0, vertex_buffer_ = 0, index_buffer_ = 0;
  GLuint framebuffer_ = 0, texture_ = 0, z_buffer_ = 0;
  std::size_t indexed_faces_ = 0;
  GLint projection_location_ = -1, max_size_ = 0;
  int width_ = 0, height_ = 0;
  std::vector<std::uint32_t> numbers_;
};

}  // namespace

RendererFactory GlRenderers(const EglContextOptions& options) {
  return [options] { return std::make_unique<GlDepthRenderer>(options); };
}

}  // namespace volalign
