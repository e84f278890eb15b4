# cmake -DOUT=FILE.cpp -DFILES=a;b -P EmbedFiles.cmake: the files as page_files of ground/service/shell/server.hpp.
set(tables "")
set(rows "")
set(count 0)
foreach(file ${FILES})
  get_filename_component(name ${file} NAME)
  file(READ ${file} hex HEX)
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${hex}")
  string(APPEND tables "constexpr unsigned char file_${count}[] = {${bytes}};\n")
  string(APPEND rows "    {\"${name}\", file_${count}, sizeof file_${count}},\n")
  math(EXPR count "${count} + 1")
endforeach()
file(WRITE ${OUT} "#include \"ground/service/shell/server.hpp\"
namespace ledgerline::ground::service {
namespace {
${tables}constexpr PageFile files[] = {
${rows}    {nullptr, nullptr, 0},
};
}  // namespace
const PageFile* const page_files = files;
const std::size_t page_file_count = ${count};
}  // namespace ledgerline::ground::service
")
