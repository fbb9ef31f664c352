#include "render/egl/gl_depth_renderer.h"

#include <epoxy/gl.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <string>

#include "core/base/error.h"

namespace volalign {

namespace {

using Vertex = FaceCorner;

// Window row 0 is image row 0, so no picture is ever flipped; z is reversed and infinite (1 at
// kNear, 0 at infinity).
const char* const kVertexShader = R"(#version 450 core
layout(location = 0) in vec3 position;
layout(location = 1) in uint id;
uniform vec4 projection;  // 2 fx / W, 2 fy / H, 2 (cx + .5) / W - 1, 2 (cy + .5) / H - 1
uniform float near;
flat out uint face_id;
void main() {
  gl_Position = vec4(projection.xy * position.xy + projection.zw * position.z, near, position.z);
  face_id = id;
}
)";

const char* const kFragmentShader = R"(#version 450 core
flat in uint face_id;
layout(location = 0) out uint id;
void main() { id = face_id; }
)";

GLuint Compile(GLenum kind, const char* source) {
  const GLuint shader = glCreateShader(kind);
  glShaderSource(shader, 1, &source, nullptr);
  glCompileShader(shader);
  GLint ok = GL_FALSE;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &ok);
  if (ok != GL_TRUE) {
    char log[1024] = "";
    glGetShaderInfoLog(shader, sizeof(log), nullptr, log);
    glDeleteShader(shader);
    throw Error(fmt::format("OpenGL: shader does not compile on {}: {}",
                            reinterpret_cast<const char*>(glGetString(GL_RENDERER)), log));
  }
  return shader;
}

GLuint LinkProgram() {
  const GLuint vertex = Compile(GL_VERTEX_SHADER, kVertexShader);
  const GLuint fragment = Compile(GL_FRAGMENT_SHADER, kFragmentShader);
  const GLuint program = glCreateProgram();
  glAttachShader(program, vertex);
  glAttachShader(program, fragment);
  glLinkProgram(program);
  glDeleteShader(vertex);
  glDeleteShader(fragment);
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

}  // namespace

GlDepthRenderer::GlDepthRenderer() {
  if (epoxy_gl_version() < 45) {
    throw Error(
        fmt::format("OpenGL: version {} is current, 4.5 is needed; make an EglContext first",
                    epoxy_gl_version() / 10.0));
  }
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
  // OpenGL takes the offset into a bound buffer as a pointer.
  // NOLINTNEXTLINE(performance-no-int-to-ptr)
  const auto offset = [](std::size_t bytes) { return reinterpret_cast<const void*>(bytes); };
  constexpr GLsizei kStride = sizeof(Vertex);
  glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, kStride, offset(offsetof(Vertex, position)));
  glVertexAttribIPointer(1, 1, GL_UNSIGNED_INT, kStride, offset(offsetof(Vertex, id)));
  for (GLuint i = 0; i < 2; ++i) glEnableVertexAttribArray(i);
  glGenFramebuffers(1, &framebuffer_);
  GLint limit = 0;
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &limit);
  max_size_ = limit;
}

GlDepthRenderer::~GlDepthRenderer() {
  glDeleteFramebuffers(1, &framebuffer_);
  glDeleteTextures(1, &id_texture_);
  glDeleteRenderbuffers(1, &z_buffer_);
  glDeleteBuffers(1, &vertex_buffer_);
  glDeleteBuffers(1, &index_buffer_);
  glDeleteVertexArrays(1, &vertex_array_);
  glDeleteProgram(program_);
}

void GlDepthRenderer::Resize(int width, int height) {
  if (width == width_ && height == height_) return;
  glDeleteTextures(1, &id_texture_);
  glDeleteRenderbuffers(1, &z_buffer_);
  glGenTextures(1, &id_texture_);
  glBindTexture(GL_TEXTURE_2D, id_texture_);
  glTexStorage2D(GL_TEXTURE_2D, 1, GL_R32UI, width, height);
  glGenRenderbuffers(1, &z_buffer_);
  glBindRenderbuffer(GL_RENDERBUFFER, z_buffer_);
  glRenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT32F, width, height);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
  glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, id_texture_, 0);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, z_buffer_);
  const GLenum status = glCheckFramebufferStatus(GL_FRAMEBUFFER);
  if (status != GL_FRAMEBUFFER_COMPLETE) {
    width_ = height_ = 0;
    throw Error(fmt::format("OpenGL: no {}x{} framebuffer of R32UI and 32-bit depth (status {:#x})",
                            width, height, status));
  }
  width_ = width;
  height_ = height;
}

void GlDepthRenderer::CollectVertices(const SceneMesh& mesh, const Intrinsics& intrinsics,
                                      const Pose& structure_from_sensor) {
  vertices_.clear();
  first_vertex_.resize(mesh.faces.size());
  // The image's outer rim.
  const std::array<float, 4> bounds = {
      static_cast<float>((-0.5 - intrinsics.cx) / intrinsics.fx),
      static_cast<float>((intrinsics.width - 0.5 - intrinsics.cx) / intrinsics.fx),
      static_cast<float>((-0.5 - intrinsics.cy) / intrinsics.fy),
      static_cast<float>((intrinsics.height - 0.5 - intrinsics.cy) / intrinsics.fy)};
  FindFacesInView(mesh, structure_from_sensor, bounds, &in_view_);
  for (const auto& [corners, inverse, id] : in_view_) {
    float z_min = 1e9F, z_max = 0;
    for (const Eigen::Vector3f& p : corners) {
      z_min = std::min(z_min, p.z());
      z_max = std::max(z_max, p.z());
    }
    // Includes the rounding of the corners themselves.
    z_min = std::max(z_min, static_cast<float>(kNear)) - 1e-5F;
    z_max += 1e-5F;
    first_vertex_[(id & 0xFFFFU) - 1] = static_cast<std::uint32_t>(vertices_.size());
    for (const Eigen::Vector3f& p : corners) vertices_.push_back({p, inverse, z_min, z_max, id});
  }
}

void GlDepthRenderer::DrawIds(const SceneMesh& mesh, const Intrinsics& pinhole,
                              const Pose& structure_from_sensor) {
  RequireDrawable(mesh, pinhole.width, pinhole.height, max_size_);
  Resize(pinhole.width, pinhole.height);
  CollectVertices(mesh, pinhole, structure_from_sensor);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
  glDrawBuffer(GL_COLOR_ATTACHMENT0);
  glViewport(0, 0, width_, height_);
  glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_GREATER);
  glDisable(GL_CULL_FACE);
  glDisable(GL_BLEND);
  const GLuint no_id[] = {0, 0, 0, 0};
  const GLfloat far[] = {0};
  glClearBufferuiv(GL_COLOR, 0, no_id);
  glClearBufferfv(GL_DEPTH, 0, far);
  glUseProgram(program_);
  glUniform4f(projection_location_, static_cast<float>(2 * pinhole.fx / pinhole.width),
              static_cast<float>(2 * pinhole.fy / pinhole.height),
              static_cast<float>(2 * (pinhole.cx + 0.5) / pinhole.width - 1),
              static_cast<float>(2 * (pinhole.cy + 0.5) / pinhole.height - 1));
  DrawVertices();
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  ids_.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
  glReadBuffer(GL_COLOR_ATTACHMENT0);
  glReadPixels(0, 0, width_, height_, GL_RED_INTEGER, GL_UNSIGNED_INT, ids_.data());
}

void GlDepthRenderer::DrawVertices() {
  glBindVertexArray(vertex_array_);
  glBindBuffer(GL_ARRAY_BUFFER, vertex_buffer_);
  glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(vertices_.size() * sizeof(Vertex)),
               vertices_.data(), GL_STREAM_DRAW);
  const std::size_t num_faces = vertices_.size() / 4;
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

void GlDepthRenderer::Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
                             const Pose& structure_from_sensor, RenderedView* view) {
  RequireDrawable(mesh, intrinsics.width, intrinsics.height, max_size_);
  const LensPicture& picture = pictures_.Get(intrinsics, PlanLensPicture);
  FitImages(intrinsics, view);
  DrawIds(mesh, picture.pinhole, structure_from_sensor);
  DrawThroughLens(picture, ids_, vertices_, first_vertex_, view);
  const GLenum error = glGetError();
  if (error == GL_CONTEXT_LOST) {
    throw Error(
        "OpenGL: the device was reset, and its context is lost; give the command again, or with "
        "the renderer cpu, which needs no OpenGL");
  }
  if (error != GL_NO_ERROR) {
    throw Error(fmt::format("OpenGL: error {:#x} while drawing {} faces at {}x{}", error,
                            vertices_.size() / 4, width_, height_));
  }
}

namespace {

class RendererWithContext : public DepthRenderer {
 public:
  explicit RendererWithContext(const EglContextOptions& options) : egl_(options) {}
  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
              const Pose& structure_from_sensor, RenderedView* view) override {
    renderer_.Render(mesh, intrinsics, structure_from_sensor, view);
  }

 private:
  EglContext egl_;
  GlDepthRenderer renderer_;  // destroyed first
};

}  // namespace

RendererFactory GlRenderers(const EglContextOptions& options) {
  return [options] { return std::make_unique<RendererWithContext>(options); };
}

}  // namespace volalign
