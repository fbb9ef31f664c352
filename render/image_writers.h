#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <filesystem>
#include <mutex>
#include <thread>
#include <vector>

#include "core/image.h"

namespace volalign {

/// Compresses and writes images on threads of its own. A few samples a thread wait in memory.
class ImageWriters {
 public:
  explicit ImageWriters(int num_threads);
  /// Ends without the images that wait; Finish() writes them.
  ~ImageWriters();
  ImageWriters(const ImageWriters&) = delete;
  ImageWriters& operator=(const ImageWriters&) = delete;

  struct Job {
    std::filesystem::path depth_path, labels_path;
    DepthImage depth;
    LabelImage labels;
    double depth_scale;  ///< m a step of the 16-bit depth
  };

  /// Waits for room. Rethrows a thread's exception.
  void Submit(Job job);

  /// Returns when all images are written. Rethrows a thread's exception.
  void Finish();

 private:
  void Work();

  const std::size_t room_for_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> jobs_;
  std::size_t unfinished_ = 0;
  std::exception_ptr failure_;
  bool stop_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace volalign
