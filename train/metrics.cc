#include "train/metrics.h"

namespace volalign {

void StepMeans::Add(const StepReport& step, std::int64_t samples) {
  ++steps_;
  samples_ += samples;
  sum_.loss += step.loss;
  sum_.loss_seg += step.loss_seg;
  sum_.loss_3d += step.loss_3d;
  sum_.degenerate += step.degenerate;
  sum_.gradient_norm += step.gradient_norm;
  sum_.times.data += step.times.data;
  sum_.times.forward += step.times.forward;
  sum_.times.loss += step.times.loss;
  sum_.times.backward += step.times.backward;
  sum_.times.optim += step.times.optim;
}

TrainRow StepMeans::Take(std::int64_t step, std::int64_t samples, double lr) {
  TrainRow row{step, samples, lr, 0, sum_};
  const double n = static_cast<double>(steps_);
  StepTimes& t = row.mean.times;
  row.samples_per_s =
      static_cast<double>(samples_) / (t.data + t.forward + t.loss + t.backward + t.optim);
  for (double* value :
       {&row.mean.loss, &row.mean.loss_seg, &row.mean.loss_3d, &row.mean.gradient_norm, &t.data,
        &t.forward, &t.loss, &t.backward, &t.optim}) {
    *value /= n;
  }
  *this = StepMeans();
  return row;
}

}  // namespace volalign
