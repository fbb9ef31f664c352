/* volalign for C and for what calls C: calibrates a rig of depth sensors from one still depth frame
 * each.
 *
 * Handles are opaque; each has a function that makes it and one that frees it (NULL is allowed
 * there). Functions that can fail return a volalign_code; VOLALIGN_OK is 0. After any other,
 * volalign_last_error() has one sentence for a person. Nothing is thrown across this border, no
 * signal handler is installed, nothing is printed. Texts are UTF-8; those that functions return
 * belong to the handle that they were asked from, and last until it is freed. A handle may be used
 * by one thread at a time; different handles by different threads.
 *
 * Lengths are in metres and angles in radians unless a name ends otherwise. Matrices are row by
 * row. Structure frame: the stack's own, y up. Sensor frame: x right, y down, z forward.
 * structure_from_sensor takes points of the sensor into the structure's frame. */
#ifndef VOLALIGN_C_H
#define VOLALIGN_C_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define VOLALIGN_API __attribute__((visibility("default")))
#else
#define VOLALIGN_API
#endif

/* The interface of this header. Functions and members are added at the end with a larger number,
 * nothing is changed or removed within one number of the library's file name (libvolalign_c.so.0).
 */
#define VOLALIGN_C_INTERFACE 1

typedef enum volalign_code {
  VOLALIGN_OK = 0,
  VOLALIGN_INVALID_ARGUMENT = 1, /* NULL, an index out of range, a structure of unknown size */
  VOLALIGN_CONFIG_ERROR = 2,     /* an option is unknown, of the wrong type or out of its range */
  VOLALIGN_DATA_ERROR = 3,       /* a file or a frame is not what it promises to be */
  VOLALIGN_IO_ERROR = 4,         /* a file could not be read or written */
  VOLALIGN_STOPPED = 5,          /* the progress function said so */
  VOLALIGN_ERROR = 6             /* anything else, out of memory too */
} volalign_code;

typedef enum volalign_status {
  VOLALIGN_SENSOR_OK = 0,
  VOLALIGN_SENSOR_WEAK = 1,
  VOLALIGN_SENSOR_FAILED = 2
} volalign_status;

typedef struct volalign_capture volalign_capture;
typedef struct volalign_options volalign_options;
typedef struct volalign_model volalign_model;
typedef struct volalign_result volalign_result;

/* VOLALIGN_C_INTERFACE of the library that is loaded: at least that of this header. */
VOLALIGN_API int volalign_interface(void);
/* For example "volalign 0.2.0 (e7d50cc1f2a3 of 2026-11-24)". */
VOLALIGN_API const char* volalign_tool(void);
/* What went wrong in the last call of this thread that failed; "" before. Lasts until the thread's
 * next failure. */
VOLALIGN_API const char* volalign_last_error(void);
/* The folder that has `configs` and `models`, where relative paths that are not in the working
 * directory are looked for. Call it before other threads use the library. */
VOLALIGN_API volalign_code volalign_set_data_folder(const char* folder);

/* Frames in memory. `structure` is the file of the stack, .yaml, or a mesh such as .glb. */
VOLALIGN_API volalign_code volalign_capture_create(const char* structure,
                                                   volalign_capture** capture);
/* capture.json and its depth files; `structure` may be NULL where it names one. */
VOLALIGN_API volalign_code volalign_capture_read(const char* path, const char* structure,
                                                 volalign_capture** capture);
VOLALIGN_API void volalign_capture_free(volalign_capture* capture);

/* One still depth frame of one sensor. Set all to zero first (memset), then struct_size to
 * sizeof(volalign_frame). */
typedef struct volalign_frame {
  size_t struct_size;
  const char* name;   /* of the sensor: letters, digits, '_', '-', '.' and the like; unique */
  const char* sensor; /* kind of device, a name of configs/intrinsics.yaml, or NULL */
  int width, height;  /* px */
  /* Pixel centres at integer coordinates: u = fx x/z + cx. */
  double fx, fy, cx, cy;
  int distortion_count; /* 0, 4, 5 or 8 */
  double distortion[8]; /* OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 */
  const float* depth; /* width * height, along the optical axis, metres, row by row, 0 where nothing
                         was measured; or NULL and */
  const uint16_t* raw;   /* the same in units of raw_scale metres */
  double raw_scale;      /* 0.001 for millimetres */
  int orientation_known; /* 0: how the sensor is mounted is found. Else: */
  int quarter_turns; /* clockwise turns that bring the picture into the network's orientation, 0 to
                        3 */
} volalign_frame;

/* Copies the frame. */
VOLALIGN_API volalign_code volalign_capture_add(volalign_capture* capture,
                                                const volalign_frame* frame);
/* The frames that are added from here on are of another still, before which the stack alone was
 * moved. */
VOLALIGN_API volalign_code volalign_capture_next_still(volalign_capture* capture);

/* The options of `volalign calibrate`; `yaml` is a file of them or NULL. */
VOLALIGN_API volalign_code volalign_options_create(const char* yaml, volalign_options** options);
/* For example "refine.size_sigma_percent", "0.7". What is wrong with a value is said here. */
VOLALIGN_API volalign_code volalign_options_set(volalign_options* options, const char* key,
                                                const char* value);
VOLALIGN_API void volalign_options_free(volalign_options* options);

/* A network, exported by `volalign export --format onnx`. OpenCV runs it. One thread at a time. */
VOLALIGN_API volalign_code volalign_model_load(const char* onnx, volalign_model** model);
VOLALIGN_API void volalign_model_free(volalign_model* model);

/* Told what begins, in a few words. Another value than 0 ends the calibration with
 * VOLALIGN_STOPPED. */
typedef int (*volalign_progress)(const char* stage, void* user);

/* Finds the poses of all sensors. model, options and progress may be NULL; without a model, poses
 * come from the shape of the stack alone. A sensor that cannot be placed is no error: its status is
 * VOLALIGN_SENSOR_FAILED, and its reason says why. */
VOLALIGN_API volalign_code volalign_calibrate(const volalign_capture* capture,
                                              volalign_model* model,
                                              const volalign_options* options,
                                              volalign_progress progress, void* user,
                                              volalign_result** result);
VOLALIGN_API void volalign_result_free(volalign_result* result);

/* Set struct_size to sizeof(volalign_sensor) before the call. */
typedef struct volalign_sensor {
  size_t struct_size;
  const char* name;
  int status;         /* volalign_status */
  const char* code;   /* "" where the status is ok; docs/calibration.md lists them */
  const char* reason; /* a sentence, "" where the status is ok */
  const char* hint;   /* what to do about it */
  int has_pose;
  double structure_from_sensor[16]; /* 4 x 4; zero without a pose */
  double
      covariance[36]; /* 6 x 6, of (translation, rotation vector) in T = Exp(delta) T^, m and rad */
  double sigma_position[3]; /* of the sensor's position along the structure's axes */
  double rms_to_structure;  /* of what it measured of the stack */
  double fx, fy, cx, cy;    /* that the pose belongs to: as given, unless the lens was estimated */
  int distortion_count;
  double distortion[8];
} volalign_sensor;

VOLALIGN_API int volalign_result_count(const volalign_result* result);
VOLALIGN_API volalign_code volalign_result_sensor(const volalign_result* result, int index,
                                                  volalign_sensor* sensor);

/* What makes the whole calibration doubtful, whichever sensor shows it. Set struct_size to
 * sizeof(volalign_finding) before the call. */
typedef struct volalign_finding {
  size_t struct_size;
  const char* code;   /* such as "size_off"; docs/calibration.md lists them */
  const char* about;  /* names of the sensors or of the box, with '\n' between them; "": all */
  const char* reason; /* what was found, in sentences */
  const char* hint;   /* what to do about it */
} volalign_finding;

/* How many there are; the likeliest cause is the first. */
VOLALIGN_API int volalign_result_finding_count(const volalign_result* result);
VOLALIGN_API volalign_code volalign_result_finding(const volalign_result* result, int index,
                                                   volalign_finding* finding);
/* What each pixel of sensor `index` shows in still `still` (0 is the first): 0 background, else the
 * number of a side. `labels` has room for `size` bytes, width * height of the sensor's frame
 * exactly. */
VOLALIGN_API volalign_code volalign_result_labels(const volalign_result* result, int index,
                                                  int still, uint8_t* labels, size_t size);
/* The content of extrinsics.json. */
VOLALIGN_API const char* volalign_result_json(const volalign_result* result);
/* The folder that `volalign calibrate -o` writes, with report.html where `with_report` is not 0. */
VOLALIGN_API volalign_code volalign_result_save(const volalign_result* result, const char* folder,
                                                int with_report);

#ifdef __cplusplus
}
#endif

#endif /* VOLALIGN_C_H */
