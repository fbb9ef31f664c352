#include "render/image_writers.h"

#include <utility>

#include "core/file_util.h"
#include "core/image_io.h"

namespace volalign {
namespace {

void WriteImages(const ImageWriters::Job& job) {
  WriteFileAtomically(job.depth_path,
                      EncodePng(FromMetres(job.depth, job.depth_scale), PngEffort::kFast),
                      /*sync=*/false);
  WriteFileAtomically(job.labels_path, EncodePng(job.labels, PngEffort::kFast), /*sync=*/false);
}

}  // namespace

ImageWriters::ImageWriters(int num_threads) : room_for_(4 * static_cast<std::size_t>(num_threads)) {
  for (int i = 0; i < num_threads; ++i) threads_.emplace_back([this] { Work(); });
}

ImageWriters::~ImageWriters() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void ImageWriters::Submit(Job job) {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return failure_ || jobs_.size() < room_for_; });
  if (failure_) std::rethrow_exception(failure_);
  jobs_.push_back(std::move(job));
  ++unfinished_;
  lock.unlock();
  changed_.notify_all();
}

void ImageWriters::Finish() {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return failure_ || unfinished_ == 0; });
  if (failure_) std::rethrow_exception(failure_);
}

void ImageWriters::Work() {
  for (;;) {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [this] { return stop_ || !jobs_.empty(); });
    if (stop_) return;
    const Job job = std::move(jobs_.front());
    jobs_.pop_front();
    lock.unlock();
    std::exception_ptr failure;
    try {
      WriteImages(job);
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    --unfinished_;
    if (failure && !failure_) failure_ = failure;
    lock.unlock();
    changed_.notify_all();
  }
}

}  // namespace volalign
