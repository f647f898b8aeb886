#include "api/handles.h"

#include <array>
#include <atomic>
#include <mutex>
#include <shared_mutex>
#include <vector>

namespace gpurt::api {
namespace {

// A handle packs mark | kind | generation | slot. The mark makes it an address that no object can have, so pointers
// given by mistake are told apart; the generation tells a released handle from the slot's next one.
static_assert(sizeof(uintptr_t) == 8, "handles are packed into 64 bits");
constexpr uint64_t mark = 0x5a;  // bits 56 to 63: not a canonical address of x86-64 or AArch64
constexpr int kind_shift = 52;
constexpr int generation_shift = 28;
constexpr uint32_t max_generation = (1u << 24) - 1;
constexpr uint32_t max_slots = 1u << 28;

struct Handle {
  HandleKind kind;
  uint32_t generation;
  uint32_t slot;
};

uintptr_t pack(Handle h)
{
  return mark << 56 | uint64_t(h.kind) << kind_shift | uint64_t(h.generation) << generation_shift | h.slot;
}

bool unpack(uintptr_t value, Handle &h)
{
  const uint64_t kind = value >> kind_shift & 0xf;
  h = {HandleKind(kind), uint32_t(value >> generation_shift) & max_generation,
       uint32_t(value & (max_slots - 1))};
  return value >> 56 == mark && kind >= uint64_t(HandleKind::Device) &&
         kind <= uint64_t(HandleKind::PhotonMap);
}

const char *name_of(HandleKind kind) { return name_with_article(kind) + 2; }

struct Slot {
  std::shared_ptr<void> object;  // null: free
  uint64_t num_references = 0;
  uint32_t generation = 0;  // of the object, or of the last one that was here
  HandleKind kind{};
  uint32_t next_free = 0;
};

constexpr uint32_t no_slot = ~uint32_t(0);
constexpr uint32_t num_shards = 16;

// Slots are dealt out to shards by the low bits of their number, so that threads rarely meet at a lock.
struct alignas(64) Shard {
  std::shared_mutex mutex;
  std::vector<Slot> slots;
  uint32_t first_free = no_slot;
};

struct Table {
  std::array<Shard, num_shards> shards;
  std::atomic<uint32_t> next_shard{0};
};

// Never destroyed: callers may release handles while the process ends.
Table &the_table()
{
  static Table *const table = new Table;
  return *table;
}

[[noreturn]] void fail_lookup(uintptr_t value, const Handle &h, bool is_handle, bool is_live,
                              HandleKind wanted, const char *what)
{
  if (value == 0) fail_invalid("{} is NULL; {} handle is needed", what, name_with_article(wanted));
  if (!is_handle)
    fail_invalid("{} is not a handle of gpurt; {} handle is needed", what, name_with_article(wanted));
  if (h.kind != wanted) {
    fail_invalid("{}: this is {} handle{}, {} is needed", what, name_with_article(h.kind),
                 is_live ? "" : " that was released", name_with_article(wanted));
  }
  fail_invalid("{}: the {} handle was released", what, name_of(wanted));
}

// Calls action(slot) for a live handle of the wanted kind while the lock is held, throws for any other value.
template <class Lock, class Action>
auto with_slot(uintptr_t value, HandleKind wanted, const char *what, Action &&action)
{
  Handle h{};
  bool is_handle = unpack(value, h), is_live = false;
  if (is_handle) {
    Shard &shard = the_table().shards[h.slot % num_shards];
    const Lock lock(shard.mutex);
    const uint32_t i = h.slot / num_shards;
    is_handle = i < shard.slots.size() && h.generation != 0 && h.generation <= shard.slots[i].generation;
    if (is_handle) {
      Slot &slot = shard.slots[i];
      is_live = slot.object && slot.generation == h.generation && slot.kind == h.kind;
      if (is_live && h.kind == wanted) return action(shard, slot);
    }
  }
  fail_lookup(value, h, is_handle, is_live, wanted, what);
}

}  // namespace

const char *name_with_article(HandleKind kind)
{
  switch (kind) {
    case HandleKind::Device:
      return "a device";
    case HandleKind::Scene:
      return "a scene";
    case HandleKind::Frame:
      return "a frame";
    case HandleKind::Job:
      return "a job";
    case HandleKind::Buffer:
      return "a buffer";
    case HandleKind::PhotonMap:
      return "a photon map";
  }
  return "a gpurt";
}

uintptr_t table::insert(HandleKind kind, std::shared_ptr<void> object)
{
  Table &all = the_table();
  const uint32_t shard_index = all.next_shard.fetch_add(1, std::memory_order_relaxed) % num_shards;
  Shard &shard = all.shards[shard_index];
  const std::unique_lock lock(shard.mutex);
  uint32_t i = shard.first_free;
  if (i == no_slot) {
    i = uint32_t(shard.slots.size());
    if (i >= max_slots / num_shards)
      fail(GPURT_ERROR_OUT_OF_MEMORY, "too many handles are alive; release some");
    shard.slots.emplace_back();
  } else {
    shard.first_free = shard.slots[i].next_free;
  }
  Slot &slot = shard.slots[i];
  slot.generation++;
  slot.kind = kind;
  slot.num_references = 1;
  slot.object = std::move(object);
  return pack({kind, slot.generation, i * num_shards + shard_index});
}

std::shared_ptr<void> table::find(uintptr_t value, HandleKind kind, const char *what)
{
  return with_slot<std::shared_lock<std::shared_mutex>>(value, kind, what,
                                                        [](Shard &, Slot &slot) { return slot.object; });
}

void table::retain(uintptr_t value, HandleKind kind, const char *what)
{
  with_slot<std::unique_lock<std::shared_mutex>>(value, kind, what,
                                                 [](Shard &, Slot &slot) { ++slot.num_references; });
}

std::shared_ptr<void> table::release(uintptr_t value, HandleKind kind, const char *what)
{
  return with_slot<std::unique_lock<std::shared_mutex>>(
      value, kind, what, [](Shard &shard, Slot &slot) -> std::shared_ptr<void> {
        if (--slot.num_references != 0) return nullptr;
        // A slot whose generations are used up is never dealt out again: a stale handle stays stale for ever.
        if (slot.generation < max_generation) {
          slot.next_free = shard.first_free;
          shard.first_free = uint32_t(&slot - shard.slots.data());
        }
        return std::move(slot.object);  // destroyed by the caller, after the lock
      });
}

}  // namespace gpurt::api
