!> Observers: what a scene asks to be recorded, and nothing else.
module lapwing_observers_recorder
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, engagement, drive_flank, coast_flank, event_impact, &
      event_kind
  use lapwing_flow, only: flow_t, work_t, instant_on
  use lapwing_hybrid_state, only: segment_t, event_t
  use lapwing_observers_averages, only: average, averages_row
  use lapwing_observers_grazes, only: find_grazes
  use lapwing_observers_records, only: recorder_t, sums_t, log_line, is_arrival, forget_cycle, &
      columns_of_averages, n_counters, max_flights, cycle_columns, sample_columns, flight_none, &
      flight_whole
  use lapwing_observers_speeds, only: count_speed
  use lapwing_system, only: system_t, instant_t, frame_t
  use lapwing_observers_tangent, only: tangent_t, carry_along, jump, tangent_row
  implicit none
  private
  public :: record_segment, look_ahead, looks_closely, write_unfinished, sample_at

contains

  !> Record one segment.
  subroutine record_segment(self, system, flow, segment, after, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(segment_t), intent(in) :: segment       !! what happened
    type(instant_t), intent(in) :: after         !! where it ended, past its events
    type(work_t), intent(inout) :: work          !! counts
    integer :: i
    if (associated(self%samples)) then
      if (sample_is_near(self, segment)) call take_samples(self, system, flow, segment, work)
    end if
    if (self%want_grazes .and. segment%moves) then
      call find_grazes(self, system, flow, segment, huge(1.0_wp), work)
      self%sums%grazes_known_to = -1
    end if
    if (self%want_strobe .or. self%want_cycles) call strobe(self, system, segment)
    if (self%want_cycles) then
      call measure(self, system, flow, segment, work)
    else if (self%want_depths) then
      call measure_flight(self%sums, system, flow, segment, work)
    end if
    if (self%want_averages) call average(self%sums%averages, system, flow, self%deviations, segment)
    if (self%want_tangent) then
      call carry_along(self%sums%tangent, system, self%deviations, segment)
    end if
    if (segment%cycle_completed .and. (self%want_strobe .or. self%want_cycles)) then
      call close_cycle(self, segment)
    end if
    if (self%want_tangent) call jump(self%sums%tangent, system, self%deviations, segment, after)
    do i = 1, segment%n_events
      call log_line(self, segment%events(i))
      call count_speed(self%density, segment%events(i))
      if (self%want_cycles) then
        call count_event(self, segment%events(i))
      else if (self%want_depths) then
        call end_flight(self%sums, segment%events(i)%kind)
      end if
    end do
  end subroutine record_segment

  !> Whether anything is recorded of each step in contact in a cycle, beyond its events: not in
  !> engagement, mostly. A cycle's first arc is looked at, where it begins.
  pure logical function looks_closely(self, instant)
    type(recorder_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where an arc begins
    looks_closely = instant%motion_state /= engagement .or. self%want_grazes &
        .or. self%want_averages .or. self%want_tangent
    if (self%want_strobe .or. self%want_cycles) looks_closely = looks_closely &
        .or. self%sums%strobe_due
    if (looks_closely .or. .not. associated(self%samples)) return
    if (self%sums%next_sample <= size(self%samples, 2)) looks_closely = &
        self%sample_time(1, self%sums%next_sample) < instant%cycle + 0.5_wp
  end function looks_closely

  !> Record what lies before `until` in a segment that is about to be taken back.
  subroutine look_ahead(self, system, flow, segment, until, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(segment_t), intent(in) :: segment       !! what happened
    real(wp), intent(in) :: until                !! time in the segment's cycle
    type(work_t), intent(inout) :: work          !! counts
    if (associated(self%samples)) then
      if (sample_is_near(self, segment)) call take_samples(self, system, flow, segment, work)
    end if
    if (self%want_grazes .and. segment%moves .and. until > segment%begin%t) then
      call find_grazes(self, system, flow, segment, until, work)
      self%sums%grazes_known_to = until
    end if
  end subroutine look_ahead

  !> Write the line of the cycle under way, where it is wanted, behind those of the cycles closed:
  !> what has been measured up to `until`, in a segment that is taken back. It is written by a copy,
  !> and what is searched for it is not counted: to go on changes no bit of what comes.
  subroutine write_unfinished(self, system, flow, segment, until)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(segment_t), intent(in) :: segment       !! what happened last
    real(wp), intent(in) :: until                !! time in the segment's cycle
    if (self%want_unfinished) call write_part(self, system, flow, segment, until)
  end subroutine write_unfinished

  !> The same, wanted.
  subroutine write_part(self, system, flow, segment, until)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(segment_t), intent(in) :: segment       !! what happened last
    real(wp), intent(in) :: until                !! time in the segment's cycle
    type(recorder_t) :: copy
    type(segment_t) :: part
    type(work_t) :: uncounted
    copy = self
    copy%want_tangent = .false.
    part = segment
    part%length = max(0.0_wp, until - segment%begin%t)
    part%moves = segment%moves .and. part%length > 0
    call strobe(copy, system, part)
    call measure(copy, system, flow, part, uncounted)
    self%unfinished = .not. copy%sums%strobe_due .and. copy%sums%n_cycles < size(copy%cycles, 2)
    if (self%unfinished) call close_cycle(copy, part)
  end subroutine write_part

  !> The cycle's first state: where its first arc of positive length begins.
  subroutine strobe(self, system, segment)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    if (.not. self%sums%strobe_due .or. segment%length <= 0) return
    self%sums%strobe_due = .false.
    self%sums%strobe(1) = segment%begin%motion_state
    call system%observe(segment%begin, self%sums%strobe(2), self%sums%strobe(3))
    self%sums%strobe_others = segment%begin%y(3:)
  end subroutine strobe

  !> States visited, and the deepest points of flights and of back contact.
  subroutine measure(self, system, flow, segment, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(segment_t), intent(in) :: segment       !! what happened
    type(work_t), intent(inout) :: work          !! counts
    real(wp) :: deepest
    associate (sums => self%sums)
      if (segment%length > 0) sums%states_visited = &
          ibset(sums%states_visited, segment%begin%motion_state)
      if (.not. segment%moves .or. segment%begin%motion_state == engagement) return
      if (segment%begin%motion_state == separation) then
        call measure_flight(sums, system, flow, segment, work)
        sums%cycle_depth = max(sums%cycle_depth, sums%flight_depth)
      else
        call flow%farthest(system, segment%arc_t, coast_flank, sums%back_penetration, deepest, work)
        sums%back_penetration = deepest
      end if
    end associate
  end subroutine measure

  !> The deepest point of the flight under way.
  subroutine measure_flight(sums, system, flow, segment, work)
    type(sums_t), intent(inout) :: sums
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(segment_t), intent(in) :: segment       !! what happened
    type(work_t), intent(inout) :: work          !! counts
    real(wp) :: deepest
    if (.not. segment%moves .or. segment%begin%motion_state /= separation) return
    call flow%farthest(system, segment%arc_t, drive_flank, sums%flight_depth, deepest, work)
    sums%flight_depth = deepest
    if (sums%flight_known == flight_none) sums%flight_known = flight_whole
  end subroutine measure_flight

  !> After an event at a flank there is no flight, or another.
  pure subroutine end_flight(sums, kind)
    type(sums_t), intent(inout) :: sums
    integer, intent(in) :: kind                  !! event_kind
    if (kind > n_counters) return
    sums%flight_known = flight_none
    sums%flight_depth = 0
    sums%flight_depth_before = 0
  end subroutine end_flight

  !> Count an event in the cycle it falls in; an impact ends a flight.
  subroutine count_event(self, event)
    type(recorder_t), intent(inout) :: self
    type(event_t), intent(in) :: event           !! the event
    real(wp) :: depth
    associate (sums => self%sums)
      if (event%kind > n_counters) return
      sums%counter(event%kind) = sums%counter(event%kind) + 1
      if (is_arrival(event%kind)) sums%fastest = max(sums%fastest, abs(event%before))
      depth = max(sums%flight_depth, sums%flight_depth_before)
      if (event%kind == event_impact) call push_flight(self, depth)
      if (event%kind == event_kind(event_impact, coast_flank)) call push_flight(self, -depth)
      call end_flight(sums, event%kind)
    end associate
  end subroutine count_event

  !> Keep the depth of a flight that an impact has ended, until the cycle's depth is known.
  subroutine push_flight(self, depth)
    type(recorder_t), intent(inout) :: self
    real(wp), intent(in) :: depth                !! rad, negative: ended at the coast flank
    associate (sums => self%sums)
      if (sums%n_flights == max_flights) call forget_shallow(self)
      if (sums%n_flights == max_flights) return
      sums%n_flights = sums%n_flights + 1
      sums%flight(sums%n_flights) = depth
    end associate
  end subroutine push_flight

  !> Drop flights too shallow to be counted: the cycle's depth can only grow.
  subroutine forget_shallow(self)
    type(recorder_t), intent(inout) :: self
    integer :: i, kept
    kept = 0
    do i = 1, self%sums%n_flights
      if (.not. abs(self%sums%flight(i)) > self%count_depth*self%sums%cycle_depth) cycle
      kept = kept + 1
      self%sums%flight(kept) = self%sums%flight(i)
    end do
    self%sums%n_flights = kept
  end subroutine forget_shallow

  !> Write the cycle's line and begin the next.
  subroutine close_cycle(self, segment)
    type(recorder_t), intent(inout) :: self
    type(segment_t), intent(in) :: segment       !! segment that ends the cycle
    integer :: counted, counted_back, others
    associate (sums => self%sums)
      call forget_shallow(self)
      counted = 0
      if (sums%n_flights > 0) counted = count(sums%flight(1:sums%n_flights) > 0)
      counted_back = sums%n_flights - counted
      sums%n_cycles = sums%n_cycles + 1
      if (sums%n_cycles <= size(self%cycles, 2)) then
        self%cycles(:cycle_columns, sums%n_cycles) = [real(segment%begin%cycle, wp), sums%strobe, &
            sums%counter(1:2), real([counted, counted_back], wp), sums%counter(3:8), &
            sums%cycle_depth, sums%back_penetration, real(sums%states_visited, wp)]
        others = size(self%cycles, 1) - columns_of_averages(self)
        self%cycles(cycle_columns + 1:others, sums%n_cycles) = &
            sums%strobe_others(:others - cycle_columns)
        if (self%want_averages) self%cycles(others + 1:, sums%n_cycles) = &
            averages_row(sums%averages)
      end if
      if (self%want_tangent) then
        if (sums%n_cycles <= size(self%tangent, 2)) then
          self%tangent(:, sums%n_cycles) = tangent_row(sums%tangent, self%deviations%n)
        end if
        sums%tangent = tangent_t()
      end if
      sums%flight_depth_before = max(sums%flight_depth, sums%flight_depth_before)
      sums%flight_depth = 0
      call forget_cycle(sums)
    end associate
  end subroutine close_cycle

  !> Whether the next sample may fall in a segment.
  pure logical function sample_is_near(self, segment)
    type(recorder_t), intent(in) :: self
    type(segment_t), intent(in) :: segment       !! what happened
    sample_is_near = self%sums%next_sample <= size(self%samples, 2)
    if (.not. sample_is_near) return
    sample_is_near = self%sample_time(1, self%sums%next_sample) < segment%begin%cycle + 0.5_wp
  end function sample_is_near

  !> Samples of the history that fall in a segment.
  subroutine take_samples(self, system, flow, segment, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(segment_t), intent(in) :: segment       !! what happened
    type(work_t), intent(inout) :: work          !! counts
    type(frame_t) :: frame
    type(instant_t) :: instant
    real(wp) :: s
    frame = segment%frame
    do while (self%sums%next_sample <= size(self%samples, 2))
      associate (time => self%sample_time(:, self%sums%next_sample))
        if (time(1) > segment%begin%cycle + 0.5_wp) return
        s = time(2) - segment%begin%t
        ! By the very sum that the run goes by: where that is past the sample nothing may follow.
        if (time(2) >= segment%begin%t + segment%length .and. .not. segment%cycle_completed) return
      end associate
      call instant_on(flow, system, segment%arc_t, s, frame, instant)
      call sample_at(self, system, instant, work)
    end do
  end subroutine take_samples

  !> Write the next sample.
  subroutine sample_at(self, system, instant, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(instant_t), intent(in) :: instant       !! where it is
    type(work_t), intent(inout) :: work          !! counts
    real(wp) :: phi, phi_dot
    call system%observe(instant, phi, phi_dot)
    associate (sample => self%samples(:, self%sums%next_sample))
      sample(:sample_columns) = [real(instant%motion_state, wp), phi, phi_dot]
      sample(sample_columns + 1:) = instant%y(3:size(sample) - sample_columns + 2)
    end associate
    self%sums%next_sample = self%sums%next_sample + 1
    work%samples = work%samples + 1
  end subroutine sample_at
end module lapwing_observers_recorder
