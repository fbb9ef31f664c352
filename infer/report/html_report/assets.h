#pragma once

namespace volalign::report_assets {

/// The files of the page, embedded by cmake/EmbedText.cmake.
extern const char kPage[];
extern const char kStyle[];
extern const char kFormatScript[];
extern const char kTablesScript[];
extern const char kFramesScript[];
extern const char kSceneScript[];
extern const char kViewerScript[];
extern const char kMainScript[];
extern const char kThree[];
extern const char kOrbitControls[];

}  // namespace volalign::report_assets
