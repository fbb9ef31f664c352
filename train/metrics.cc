#include "train/metrics.h"

namespace volalign {

void StepMeans::Add(const StepReport& step, std::int64_t step_samples) {
  ++steps;
  samples += step_samples;
  sum.loss += step.loss;
  sum.loss_seg += step.loss_seg;
  sum.loss_3d += step.loss_3d;
  sum.degenerate += step.degenerate;
  sum.gradient_norm += step.gradient_norm;
  sum.times.data += step.times.data;
  sum.times.forward += step.times.forward;
  sum.times.loss += step.times.loss;
  sum.times.backward += step.times.backward;
  sum.times.optim += step.times.optim;
}

TrainRow StepMeans::Take(std::int64_t step, std::int64_t samples_so_far, double lr) {
  TrainRow row{step, samples_so_far, lr, 0, sum};
  const double n = static_cast<double>(steps);
  StepTimes& t = row.mean.times;
  row.samples_per_s =
      static_cast<double>(samples) / (t.data + t.forward + t.loss + t.backward + t.optim);
  for (double* value :
       {&row.mean.loss, &row.mean.loss_seg, &row.mean.loss_3d, &row.mean.gradient_norm, &t.data,
        &t.forward, &t.loss, &t.backward, &t.optim}) {
    *value /= n;
  }
  *this = StepMeans();
  return row;
}

}  // namespace volalign
