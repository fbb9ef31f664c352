#include "tests/run_tests.h"

int main(int argc, char** argv) { return volalign::RunTests(argc, argv); }
