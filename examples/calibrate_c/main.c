/* Calibrates sensors whose depth frames a C program has in memory, and prints where they stand.
 *
 *     calibrate_c structure.yaml model.onnx sensors.txt [folder for the result]
 *
 * "-" for a model: poses from the shape of the stack alone. A line of sensors.txt is a sensor: name, kind or "-", fx, fy, cx, cy, a 16-bit PGM file in
 * millimetres, and the coefficients of its lens, if any. The files stand for what a program gets from its sensors. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <volalign.h>

static void require(volalign_code code) {
  if (code == VOLALIGN_OK) return;
  fprintf(stderr, "error %d: %s\n", (int)code, volalign_last_error());
  exit(1);
}

/* Binary PGM has the high byte first. */
static uint16_t* read_pgm(const char* path, int* width, int* height) {
  FILE* file = fopen(path, "rb");
  unsigned char bytes[2];
  uint16_t* depth;
  int i;
  if (!file || fscanf(file, "P5 %d %d 65535", width, height) != 2 || fgetc(file) == EOF) {
    fprintf(stderr, "%s: no 16-bit PGM file\n", path);
    exit(1);
  }
  depth = malloc(sizeof(uint16_t) * (size_t)*width * (size_t)*height);
  for (i = 0; depth && i < *width * *height && fread(bytes, 2, 1, file) == 1; ++i) depth[i] = (uint16_t)(bytes[0] << 8 | bytes[1]);
  fclose(file);
  return depth;
}

static int print_stage(const char* stage, void* user) {
  (void)user;
  fprintf(stderr, "%s\n", stage);
  return 0; /* go on */
}

int main(int argc, char** argv) {
  volalign_capture* capture = NULL;
  volalign_model* model = NULL;
  volalign_result* result = NULL;
  FILE* list;
  char line[4096], name[256], kind[256], path[2048];
  int i, k, read, failed = 0;
  if (argc < 4) {
    fprintf(stderr, "usage: %s structure.yaml model.onnx|- sensors.txt [folder]\n", argv[0]);
    return 2;
  }
  require(volalign_capture_create(argv[1], &capture));
  if (strcmp(argv[2], "-") != 0) require(volalign_model_load(argv[2], &model));
  list = fopen(argv[3], "r");
  if (!list) return 2;
  while (fgets(line, sizeof line, list)) {
    volalign_frame frame;
    uint16_t* depth;
    char* rest;
    memset(&frame, 0, sizeof frame);
    frame.struct_size = sizeof frame;
    if (sscanf(line, "%255s %255s %lf %lf %lf %lf %2047s%n", name, kind, &frame.fx, &frame.fy, &frame.cx, &frame.cy, path, &read) != 7) continue;
    for (rest = line + read; frame.distortion_count < 8; ++frame.distortion_count) {
      char* end;
      frame.distortion[frame.distortion_count] = strtod(rest, &end);
      if (end == rest) break;
      rest = end;
    }
    depth = read_pgm(path, &frame.width, &frame.height);
    frame.name = name;
    frame.sensor = strcmp(kind, "-") == 0 ? NULL : kind;
    frame.raw = depth;
    frame.raw_scale = 0.001;
    require(volalign_capture_add(capture, &frame));
    free(depth);
  }
  fclose(list);
  require(volalign_calibrate(capture, model, NULL, print_stage, NULL, &result));
  for (i = 0; i < volalign_result_count(result); ++i) {
    volalign_sensor sensor;
    sensor.struct_size = sizeof sensor;
    require(volalign_result_sensor(result, i, &sensor));
    failed += sensor.status == VOLALIGN_SENSOR_FAILED;
    printf("%s %d", sensor.name, sensor.status);
    for (k = 0; sensor.has_pose && k < 16; ++k) printf(" %.17g", sensor.structure_from_sensor[k]);
    printf("%s%s\n", sensor.reason[0] ? " # " : "", sensor.reason);
  }
  if (argc > 4) require(volalign_result_save(result, argv[4], 1));
  volalign_result_free(result);
  volalign_model_free(model);
  volalign_capture_free(capture);
  return failed ? 3 : 0;
}
