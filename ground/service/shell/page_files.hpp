#pragma once
#include <cstddef>

/// The page, as it is built into a program: by ledgerline_station_page, or without its libraries by
/// ledgerline_plain_station_page.
namespace ledgerline::ground::service {

struct PageFile {
  const char* name;  ///< "main.js", "lib/uPlot.esm.js"
  const unsigned char* bytes;
  std::size_t size;
  bool gzip;  ///< that is how the bytes are kept
};
extern const PageFile* const page_files;
extern const std::size_t page_file_count;
/// The scripts that stand in the page itself, as its Content-Security-Policy names them: 'sha256-...'.
extern const char* const page_scripts;

}  // namespace ledgerline::ground::service
