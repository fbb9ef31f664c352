#include "cli/main.h"

int main(int argc, char** argv) { return volalign::Main(argc, argv); }
