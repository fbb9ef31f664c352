#include "core/nn/tensor_archive.h"

#include <ATen/ops/empty.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"

namespace volalign {
namespace {

constexpr std::size_t kMaxPickleBytes = std::size_t{4} << 20;
constexpr std::size_t kMostValues = 100000;  // at a time, and remembered
constexpr int kMaxDepth = 16;
constexpr std::size_t kMostDimensions = 16;

[[noreturn]] void Fail(const std::string& what) { throw DataError(what); }

/// A little-endian number of `count` bytes at `at`.
std::uint64_t NumberAt(std::string_view bytes, std::size_t at, std::size_t count) {
  if (at > bytes.size() || count > bytes.size() - at) Fail("it is truncated");
  std::uint64_t number = 0;
  for (std::size_t i = count; i-- > 0;)
    number = number << 8 | static_cast<unsigned char>(bytes[at + i]);
  return number;
}

std::string_view Part(std::string_view bytes, std::uint64_t at, std::uint64_t size) {
  if (at > bytes.size() || size > bytes.size() - at) Fail("it is truncated");
  return bytes.substr(at, size);
}

using Records = std::map<std::string, std::string_view>;

/// The files of a zip archive (PKWARE's APPNOTE.TXT, sections 4.3.7, 4.3.12 and 4.3.16), which are
/// stored, as `torch.save` does.
Records ReadZip(std::string_view bytes) {
  constexpr char kEnd[] = "PK\x05\x06", kEntry[] = "PK\x01\x02", kLocal[] = "PK\x03\x04";
  constexpr std::size_t kEndSize = 22, kEntrySize = 46, kLocalSize = 30;
  const std::size_t end = bytes.rfind(kEnd);
  if (bytes.compare(0, 4, kLocal) != 0 || end == bytes.npos || bytes.size() - end < kEndSize)
    Fail("no zip archive, or a truncated one");
  const std::uint64_t count = NumberAt(bytes, end + 10, 2);
  std::uint64_t at = NumberAt(bytes, end + 16, 4);
  Records records;
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::string_view entry = Part(bytes, at, kEntrySize);
    if (entry.substr(0, 4) != kEntry) Fail("its list of files is damaged");
    if (NumberAt(entry, 10, 2) != 0) Fail("its files are compressed");
    const std::uint64_t name_size = NumberAt(entry, 28, 2);
    const std::string name(Part(bytes, at + kEntrySize, name_size));
    const std::uint64_t local_at = NumberAt(entry, 42, 4);
    const std::string_view local = Part(bytes, local_at, kLocalSize);
    if (local.substr(0, 4) != kLocal) Fail("its list of files is damaged");
    const std::uint64_t data_at =
        local_at + kLocalSize + NumberAt(local, 26, 2) + NumberAt(local, 28, 2);
    if (!records.emplace(name, Part(bytes, data_at, NumberAt(entry, 24, 4))).second)
      Fail(fmt::format("it has two files {}", Shortened(name)));
    at += kEntrySize + name_size + NumberAt(entry, 30, 2) + NumberAt(entry, 32, 2);
  }
  return records;
}

struct Value;
using Shared = std::shared_ptr<Value>;

/// A value of the pickle. Only dictionaries change after they were made.
struct Value {
  enum class Kind { kText, kNumber, kFunction, kTuple, kDictionary, kStorage, kTensor };
  Kind kind = Kind::kText;
  std::string text;                       // of kText, kFunction
  std::int64_t number = 0;                // of kNumber; truth is 0 or 1
  std::vector<Shared> items;              // of kTuple, kStorage
  std::map<std::string, Shared> entries;  // of kDictionary
  at::Tensor tensor;
  int depth = 1;  // of kTuple
};
using Kind = Value::Kind;

Shared Make(Kind kind) {
  auto value = std::make_shared<Value>();
  value->kind = kind;
  return value;
}

/// Where the values that a tuple or dictionary is made of begin.
bool IsMark(const Shared& value) { return value == nullptr; }

const Value& Of(const Shared& value, Kind kind) {
  if (IsMark(value) || value->kind != kind) Fail("its pickle has a value where another belongs");
  return *value;
}

struct ElementType {
  const char* storage;
  at::ScalarType type;
};
constexpr ElementType kTypes[] = {
    {"torch FloatStorage", at::kFloat},      {"torch HalfStorage", at::kHalf},
    {"torch DoubleStorage", at::kDouble},    {"torch LongStorage", at::kLong},
    {"torch IntStorage", at::kInt},          {"torch ByteStorage", at::kByte},
    {"torch BFloat16Storage", at::kBFloat16}};

constexpr char kRebuild[] = "torch._utils _rebuild_tensor_v2";
constexpr char kOrdered[] = "collections OrderedDict";
constexpr char kTyped[] = "torch.jit._pickle restore_type_tag";

bool IsKnown(const std::string& function) {
  return function == kRebuild || function == kOrdered || function == kTyped ||
         std::any_of(std::begin(kTypes), std::end(kTypes),
                     [&](const ElementType& type) { return function == type.storage; });
}

/// Follows a pickle (Python's pickletools.py describes the instructions).
class Unpickler {
 public:
  Unpickler(const Records& records, std::string folder, std::uint64_t most_bytes)
      : records_(records), folder_(std::move(folder)), bytes_left_(most_bytes) {}

  Shared Run(std::string_view pickle) {
    pickle_ = pickle;
    at_ = 0;
    for (;;) {
      const auto op = static_cast<unsigned char>(Take(1)[0]);
      if (op == '.') break;
      Step(op);
      if (stack_.size() > kMostValues || memo_.size() > kMostValues)
        Fail("its pickle has too many values");
    }
    if (stack_.size() != 1) Fail("its pickle is damaged");
    return Pop();
  }

 private:
  void Step(unsigned char op) {
    switch (op) {
      case 0x80:  // PROTO
        if (Take(1)[0] != 2) Fail("its pickle is of another protocol than 2");
        return;
      case 'c': {  // GLOBAL
        const Shared function = Make(Kind::kFunction);
        function->text = Line() + " ";
        function->text += Line();
        if (!IsKnown(function->text))
          Fail(fmt::format("its pickle asks for {}, which no tensor needs",
                           Shortened(function->text)));
        return Push(function);
      }
      case 'X': {  // BINUNICODE
        const Shared text = Make(Kind::kText);
        text->text = Take(Number(4));
        return Push(text);
      }
      case 'K':  // BININT1
        return PushNumber(static_cast<std::int64_t>(Number(1)));
      case 'M':  // BININT2
        return PushNumber(static_cast<std::int64_t>(Number(2)));
      case 'J':  // BININT
        return PushNumber(static_cast<std::int32_t>(Number(4)));
      case 0x8a:  // LONG1, of eight bytes as torch writes it
        if (Number(1) != 8) Fail("its pickle has a number of another size than eight bytes");
        return PushNumber(static_cast<std::int64_t>(Number(8)));
      case 0x88:  // NEWTRUE
        return PushNumber(1);
      case 0x89:  // NEWFALSE
        return PushNumber(0);
      case '(':  // MARK
        return Push(nullptr);
      case '}':  // EMPTY_DICT
        return Push(Make(Kind::kDictionary));
      case ')':  // EMPTY_TUPLE
        return PushTuple({});
      case 't':  // TUPLE
        return PushTuple(PopToMark());
      case 0x85:  // TUPLE1
      case 0x86:  // TUPLE2
      case 0x87:  // TUPLE3
        return PushTuple(PopLast(op - 0x84u));
      case 's': {  // SETITEM
        const std::vector<Shared> pair = PopLast(2);
        return SetItems(pair);
      }
      case 'u':  // SETITEMS
        return SetItems(PopToMark());
      case 'q':  // BINPUT
        memo_[Number(1)] = Top();
        return;
      case 'r':  // LONG_BINPUT
        memo_[Number(4)] = Top();
        return;
      case 'h':  // BINGET
        return Recall(Number(1));
      case 'j':  // LONG_BINGET
        return Recall(Number(4));
      case 'Q': {  // BINPERSID
        const Shared storage = Make(Kind::kStorage);
        storage->items = Of(Pop(), Kind::kTuple).items;
        return Push(storage);
      }
      case 'R': {  // REDUCE
        const Shared arguments = Pop(), function = Pop();
        return Push(Result(Of(function, Kind::kFunction).text, Of(arguments, Kind::kTuple).items));
      }
      default:
        Fail(fmt::format("its pickle has the instruction 0x{:02x}, which no tensor needs", op));
    }
  }

  Shared Result(const std::string& function, const std::vector<Shared>& arguments) {
    if (function == kOrdered && arguments.empty()) return Make(Kind::kDictionary);
    if (function == kTyped && arguments.size() == 2 && !IsMark(arguments[0])) return arguments[0];
    if (function == kRebuild && arguments.size() == 6) return Tensor(arguments);
    Fail(fmt::format("its pickle has wrong arguments of {}", function));
  }

  /// storage, offset, sizes, strides, requires_grad, hooks.
  Shared Tensor(const std::vector<Shared>& arguments) {
    // "storage", type, key, device, count.
    const std::vector<Shared>& storage = Of(arguments[0], Kind::kStorage).items;
    if (storage.size() != 5 || Of(storage[0], Kind::kText).text != "storage")
      Fail("its pickle has a tensor without memory");
    const std::string& stored_as = Of(storage[1], Kind::kFunction).text;
    const ElementType* const type =
        std::find_if(std::begin(kTypes), std::end(kTypes),
                     [&](const ElementType& t) { return stored_as == t.storage; });
    if (type == std::end(kTypes)) Fail("its pickle has a tensor of unknown type");
    const std::string& key = Of(storage[2], Kind::kText).text;
    const std::int64_t count = Of(storage[4], Kind::kNumber).number;
    const std::vector<std::int64_t> sizes = Numbers(arguments[2]), strides = Numbers(arguments[3]);
    const auto record = records_.find(folder_ + "data/" + key);
    if (record == records_.end()) Fail(fmt::format("it has no record {}", Shortened(key)));
    const std::size_t bytes = record->second.size();
    if (count < 0 || bytes / at::elementSize(type->type) != static_cast<std::uint64_t>(count) ||
        bytes % at::elementSize(type->type) != 0 || Of(arguments[1], Kind::kNumber).number != 0 ||
        !IsWhole(sizes, strides, count))
      Fail(fmt::format("the tensor in its record {} is damaged", Shortened(key)));
    // Records may overlap, and tensors may name one record: together they have no more than there
    // is.
    if (!used_.insert(key).second || bytes > bytes_left_)
      Fail(fmt::format("the tensor in its record {} shares memory", Shortened(key)));
    bytes_left_ -= bytes;
    Shared value = Make(Kind::kTensor);
    value->tensor = at::empty(sizes, at::TensorOptions().dtype(type->type));
    if (bytes > 0) std::memcpy(value->tensor.data_ptr(), record->second.data(), bytes);
    return value;
  }

  /// Whether a tensor of these sizes is `count` values, one after the other. Of none, all sizes are
  /// 0 or 1: LibTorch multiplies them.
  static bool IsWhole(const std::vector<std::int64_t>& sizes,
                      const std::vector<std::int64_t>& strides, std::int64_t count) {
    if (sizes.size() != strides.size() || sizes.size() > kMostDimensions) return false;
    std::int64_t stride = 1;
    bool empty = false;
    for (std::size_t d = sizes.size(); d-- > 0;) {
      if (sizes[d] < 0 || (sizes[d] > 1 && stride > count / sizes[d])) return false;
      // Where there is one step there is none to a next one.
      if (sizes[d] > 1 && strides[d] != stride) return false;
      empty = empty || sizes[d] == 0;
      stride *= std::max<std::int64_t>(sizes[d], 1);
    }
    return empty ? count == 0 : stride == count;
  }

  static std::vector<std::int64_t> Numbers(const Shared& tuple) {
    std::vector<std::int64_t> numbers;
    for (const Shared& item : Of(tuple, Kind::kTuple).items)
      numbers.push_back(Of(item, Kind::kNumber).number);
    return numbers;
  }

  /// Into the dictionary on top of the stack. A dictionary in it holds none, so that none is within
  /// itself.
  void SetItems(const std::vector<Shared>& pairs) {
    const Shared& dictionary = Top();
    Of(dictionary, Kind::kDictionary);
    if (pairs.size() % 2 != 0) Fail("its pickle is damaged");
    for (std::size_t i = 0; i < pairs.size(); i += 2) {
      const Shared& value = pairs[i + 1];
      const bool plain =
          !IsMark(value) && (value->kind == Kind::kText || value->kind == Kind::kTensor);
      if (!plain) {
        if (value == dictionary) Fail("its pickle has a dictionary within itself");
        for (const auto& [name, inner] : Of(value, Kind::kDictionary).entries) {
          if (inner->kind == Kind::kDictionary) Fail("its dictionaries are nested too deep");
        }
      }
      dictionary->entries[Of(pairs[i], Kind::kText).text] = value;
    }
  }

  std::string_view Take(std::uint64_t count) {
    if (count > pickle_.size() - at_) Fail("its pickle is truncated");
    at_ += count;
    return pickle_.substr(at_ - count, count);
  }
  std::uint64_t Number(std::size_t count) { return NumberAt(Take(count), 0, count); }
  std::string Line() {
    const std::size_t end = pickle_.find('\n', at_);
    if (end == pickle_.npos) Fail("its pickle is truncated");
    std::string line(Take(end - at_));
    Take(1);
    return line;
  }

  void Push(Shared value) { stack_.push_back(std::move(value)); }
  void PushNumber(std::int64_t number) {
    const Shared value = Make(Kind::kNumber);
    value->number = number;
    Push(value);
  }
  void PushTuple(std::vector<Shared> items) {
    const Shared tuple = Make(Kind::kTuple);
    for (const Shared& item : items) tuple->depth = std::max(tuple->depth, 1 + item->depth);
    if (tuple->depth > kMaxDepth) Fail("its tuples are nested too deep");
    tuple->items = std::move(items);
    Push(tuple);
  }
  /// The topmost value, which is no mark.
  const Shared& Top() {
    if (stack_.empty() || IsMark(stack_.back())) Fail("its pickle takes a value that is not there");
    return stack_.back();
  }
  Shared Pop() {
    Shared value = Top();
    stack_.pop_back();
    return value;
  }
  std::vector<Shared> PopLast(std::size_t count) {
    std::vector<Shared> values(count);
    for (std::size_t i = count; i-- > 0;) values[i] = Pop();
    return values;
  }
  std::vector<Shared> PopToMark() {
    const auto mark = std::find(stack_.rbegin(), stack_.rend(), nullptr);
    if (mark == stack_.rend()) Fail("its pickle takes a value that is not there");
    std::vector<Shared> values(mark.base(), stack_.end());
    stack_.erase(mark.base() - 1, stack_.end());
    return values;
  }
  void Recall(std::uint64_t number) {
    const auto found = memo_.find(number);
    if (found == memo_.end()) Fail("its pickle takes a value that is not there");
    Push(found->second);
  }

  const Records& records_;
  const std::string folder_;
  std::uint64_t bytes_left_;
  std::string_view pickle_;
  std::size_t at_ = 0;
  std::vector<Shared> stack_;
  std::map<std::uint64_t, Shared> memo_;
  std::set<std::string> used_;
};

}  // namespace

TensorArchive ReadTensorArchive(std::string_view bytes) {
  const Records records = ReadZip(bytes);
  const std::string name = "data.pkl";
  const auto found = std::find_if(records.begin(), records.end(), [&](const auto& record) {
    const std::size_t slash = record.first.find('/');
    return slash != std::string::npos && record.first.substr(slash + 1) == name;
  });
  if (found == records.end()) Fail("it has no data.pkl");
  if (found->second.size() > kMaxPickleBytes) Fail("its data.pkl has more than 4 MiB");
  const std::string folder = found->first.substr(0, found->first.size() - name.size());
  const Shared root = Unpickler(records, folder, bytes.size()).Run(found->second);

  TensorArchive archive;
  for (const auto& [key, value] : Of(root, Kind::kDictionary).entries) {
    if (value->kind == Kind::kText) {
      archive.texts[key] = value->text;
      continue;
    }
    auto& tensors = archive.tensors[key];
    for (const auto& [tensor_name, tensor] : Of(value, Kind::kDictionary).entries)
      tensors.emplace(tensor_name, Of(tensor, Kind::kTensor).tensor);
  }
  return archive;
}

}  // namespace volalign
