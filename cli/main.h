#pragma once

namespace volalign {

/// The program `volalign` with its command line, as a library call: sub-commands, options, --set,
/// signals, output and exit status. Another program registers a network (core/nn/network.h), a term
/// of the loss (train/loss_term.h) or a noise model (render/noise.h), and returns this.
/// @return the exit status; errors are written to standard error
int Main(int argc, char** argv);

}  // namespace volalign
